"""Skin packages: all that the fast method reads at run time, as files that an engine imports and a
web server can serve as they are."""
