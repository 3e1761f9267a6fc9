"""Assets: their state, how they are created, built, kept, and brought to the device."""
