"""The parts of one asset on the device."""
