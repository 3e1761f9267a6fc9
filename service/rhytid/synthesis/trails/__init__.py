"""Which edges become wrinkles: trails of walkers, primary lines, lines that go on."""
