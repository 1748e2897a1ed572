"""Tables of keys that several kinds of scenes share."""
