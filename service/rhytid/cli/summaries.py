"""What each command does, in the words of `rhytid --help`, which imports no command for them."""

from __future__ import annotations

# In the order of the help.
SUMMARIES = {
    "serve": "Serve displacement tiles over HTTP until interrupted.",
    "keys": "Make, list and revoke the API keys of a server, whether it runs or not.",
    "snapshot": "Write a built asset into one file, which `rhytid restore` and servers take.",
    "restore": "Put assets from snapshots into a store, under their ids; nothing is synthesised.",
    "devices": "List the OpenCL devices; 'used' marks the one that rhytid computes on.",
    "check": (
        "Check a mesh and its frames: parts, borders, triangles, UV, texel size, length. "
        "Nothing is computed on a device. The status is 0 whatever is found, 1 where the "
        "mesh cannot be used, or has warnings and --strict is given. With --scan the "
        "displacement is read, too, and measured on the mesh: bits, depth, midlevel, "
        "seams."
    ),
    "convert": "Write a mesh and its animation as one npz, to send it to a server: USD, too.",
    "synthesize": (
        "Grow pores and wrinkles on a neutral mesh, write them as safetensors and print "
        "their figures. Folders that do not exist are created."
    ),
    "graph": (
        "Print the figures of a wrinkle graph, made here or elsewhere, and write it as "
        "curves or as a picture. Folders that do not exist are created."
    ),
    "template": (
        "Write what to paint over, and masks to begin with: grey images that change nothing yet."
    ),
    "controls": (
        "Draw one patch of skin with every mask and setting of the look at three values each."
    ),
    "transfer": (
        "Carry a wrinkle graph to another topology or UV of the same head, or to a head "
        "that lies near it, and report what was lost on the way."
    ),
    "bake": (
        "Write the displacement of an animation as textures; continues where it was interrupted."
    ),
    "displace": (
        "Move a mesh by a scanned, sculpted or baked displacement map, its triangles subdivided."
    ),
    "trace": (
        "Find the lines and pores of a scanned or sculpted displacement map, as a wrinkle graph."
    ),
    "measure": (
        "Measure heights, slopes and directions of patches of skin, at rest and under strain."
    ),
    "look": "Write a USD layer and a MaterialX document that displace a mesh by baked maps.",
    "export": (
        "Write a skin package: mesh, textures and the shader of the fast method, for engines."
    ),
    "warnings": "Explain warnings and notices: when they are reported, and what to do.",
    "completion": "Print a script by which a shell completes commands, options and file names.",
}
