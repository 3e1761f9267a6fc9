"""Baking: the frames of an animation as files of maps, on this machine or on many.

`bake` in `rhytid.baking.bake` does what a `BakeRequest` asks for; `rhytid bake` makes one of its
options. Other commands read their files and build their assets here, too.
"""
