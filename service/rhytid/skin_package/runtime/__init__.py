"""What a package hands out to be run elsewhere: templates of shaders, and stretch in Python and in
JavaScript. `stretch.py` needs numpy alone."""
