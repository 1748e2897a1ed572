"""What several kinds of scenes share: tables of keys, options of commands, what is plausible."""
