"""Contact of a skin with itself, the ground and bodies, by barriers and friction (IPC)."""
