"""Files for other programs: textures, skin packages, looks, curves and meshes."""
