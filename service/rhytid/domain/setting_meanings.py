"""What each setting of an asset means, by its dotted name."""

from __future__ import annotations

# In Markdown without links: the OpenAPI document and docs/reference/settings.md show it.
MEANINGS: dict[str, str] = {
    "name": (
        "what people call the asset; null is the name of the mesh's file without its ending where "
        "an asset is sent, none in a PATCH. The same content with another name is the same asset, "
        "and keeps the name that it has"
    ),
    "unit": (
        "length unit of the mesh, written into files: mm, cm, dm, m, um, in or ft, or a number of "
        'one, as `"5.5cm"`; or any other where no length follows from it; null is that of a given '
        "graph, else cm"
    ),
    "resolution": "texels per side",
    "tile_size": (
        "texels per side of a tile, `resolution` at most; where it is not given and the default is "
        "above the resolution, it is the resolution"
    ),
    "depth": (
        "depth of a wrinkle of strength 1, mesh units; null is what a given graph says, else 0.15 "
        "of the pore spacing: 75 µm by default, more with `graph.age` above 35"
    ),
    "padding": "texels around the UV charts that take the nearest triangle",
    "angles": (
        "where angles between wrinkles and axes of stretch are taken: in UV, as the paper does, "
        'or in the neutral tangent plane (`"surface"`)'
    ),
    "preset": (
        "choice of bins, the closest to `redraw` at no more than twice the paper's time, with "
        'lines that bend and soft limits; or `"paper"`, which has none of these, in any method; '
        "keys of `bins`, `shape` and `response` override it"
    ),
    "graph.spacing": (
        "mean distance from a pore to the nearest where density is 1, mesh units; null is 0.5 mm "
        "through `unit`"
    ),
    "graph.wrinkles": (
        "wrinkles to synthesise where density is 1 and nothing is painted; null is as many as "
        "area and spacing make; a number fixes the spacing instead"
    ),
    "graph.seed": (
        "start of the random numbers: another seed gives another skin of the same kind; null is "
        "what a given graph says, else 1"
    ),
    "graph.neighbours": "candidate edges of a pore",
    "graph.lines": (
        'what lines run by: `"expressions"`, across what they fold; `"level"`, around the '
        'vertical axis; null or `"auto"`, by expressions where there are any'
    ),
    "graph.region": (
        "what skin it is where no mask says otherwise: `face`, `forehead`, `cheek`, `nose`, "
        "`lip`, `eye_corner` or `neck`"
    ),
    "graph.age": (
        "age of the skin: deeper, wider and fewer lines, most where skin folds; pores stay"
    ),
    "graph.density": "factor of the number of wrinkles",
    "graph.strength": (
        "factor of the strength of each wrinkle and pore, 1 at most: 2 is twice as deep where one "
        "lies alone; where many overlap the relief grows less, and grain and undulation stay; "
        "`depth` scales all of it"
    ),
    "graph.turn": "degrees by which lines turn left of the preferred ones",
    "graph.anisotropy": ("how far lines keep to their direction: 0 any way, 2 one direction alone"),
    "graph.scale": "factor of the width of wrinkles",
    "graph.pore_radius": "factor of the radius of pores",
    "response.alpha_w": "how much stretch widens a wrinkle (Alg. 1)",
    "response.alpha_d": "how much stretch flattens a wrinkle (Alg. 1)",
    "response.beta_w": "how much stretch widens a pore (Alg. 2)",
    "response.beta_d": "how much stretch flattens a pore (Alg. 2)",
    "response.log_stretch_limit": "largest absolute log stretch, against sliver triangles",
    "response.ends": (
        "how far the log stretch at the ends of a wrinkle goes from its own, 0, to the mean of "
        "its own and that of the wrinkle that continues it there, 1; width and strength follow "
        "from it at each end and are linear between"
    ),
    "response.soft_limits": ("log stretch and scales bend into their limits, in place of a clamp"),
    "response.pore_depth_limit": (
        "how many times as deep a pore becomes at most; wrinkles 4 times"
    ),
    "shape.wrinkle_bulge": (
        "the bulge beside a furrow; 2.5 suits skin without cushions, 7 displaces no volume"
    ),
    "shape.pore_bulge": "the bulge around a pore; 4 displaces no volume",
    "shape.sharpness": "beta of the mellow-max by which heights meet",
    "shape.slots": "n of the mellow-max; 1 keeps the depth of a lone wrinkle, 16 is softer",
    "shape.wave_amplitude": (
        "how far wrinkles swing across their straight line, mesh units, at most a fifth of their "
        "length; 0 is straight"
    ),
    "shape.wave_frequency": (
        "waves per mesh unit; null is what a given graph says, else 0.4 per pore spacing"
    ),
    "shape.curvature": "how much of its bends a wrinkle is drawn with; 0 is straight",
    "shape.taper": (
        "how much strength and width change along a wrinkle, from one end to the other; 0 is even"
    ),
    "shape.least_half_width": (
        "least half width, texels: what is narrower is drawn that wide and shallower to match, so "
        "that it does not break into dots; 0 is off"
    ),
    "shape.cushion": (
        "share of the depth of wrinkles that a second, broad layer of them carries, so that skin "
        "swells between furrows; lines of strength 0.08 or less are in the narrow one only; 0 is "
        "off"
    ),
    "shape.cushion_width": (
        "how many times as wide as a furrow the broad layer is; of a wrinkle with `edge_metric`, "
        "in that metric"
    ),
    "shape.cushion_sharpness": "beta of the mellow-max by which heights meet in the broad layer",
    "shape.grain": (
        "root mean square of the micro relief between lines, in depths, times what region and age "
        "make of it; 0 is off"
    ),
    "shape.grain_size": (
        "largest wavelength of the grain, mesh units; null is what a given graph says, else 0.2 mm "
        "where `unit` is a length, else 0.36 of the pore spacing"
    ),
    "shape.undulation": "root mean square of broad swells of the skin, in depths; 0 is off",
    "shape.undulation_size": (
        "largest wavelength of the swells, mesh units; the smallest is an eighth of it; null is "
        "what a given graph says, else 6 mm where `unit` is a length, else 10.8 of the pore "
        "spacing"
    ),
    "bins.count": "orientation bins, N",
    "bins.samples": "stretches that each bin is drawn at, M",
    "bins.pore_samples": ("stretches that the pores are drawn at; null is `bins.samples`"),
    "bins.bits": "bits per code of the precomputed maps",
    "bins.merge": (
        "how bins meet: `min`, the deepest wins; `soft`, the two deepest valleys meet softly and "
        "the highest bulge is added; `signed`, by the mellow-max as wrinkles meet, from one "
        "signed map; `mellow`, the same from two maps, valleys and bulges"
    ),
    "bins.depth_factored": (
        "draw maps without their depth scale and multiply it on later, so that depth follows "
        "stretch beyond `bins.r_max`"
    ),
    "bins.tilt": (
        "one more map per bin says where in it each wrinkle runs, so that depth follows its own "
        "angle; needs `bins.depth_factored`"
    ),
    "bins.reach": (
        "the outer samples lie at this times `bins.r_max`, up to `response.log_stretch_limit`"
    ),
    "bins.r_max": "log stretch that most of the skin stays within; calibrated from a frame",
    "convolve.blur_gain": (
        "how much stretch blurs lines and pores, for `convolved`; grain and undulation are added "
        "after its kernel, as in every method"
    ),
    "convolve.sharpen_gain": "how much compression sharpens them, for `convolved`",
    "convolve.sigma": (
        "standard deviation of the Gaussian of `convolved`, mesh units; null is what a given graph "
        "says, else 0.25 of the pore spacing"
    ),
}
