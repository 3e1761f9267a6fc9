"""API keys: how they are made, kept in a file, and found again when one is shown."""
