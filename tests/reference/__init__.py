"""What the product computes, written again in float64 numpy: plain, slow, apart from the product.

Nothing here imports rhytid. Arrays go in and arrays come out; every module is one step of the
paper (*Fast Dynamic Facial Wrinkles*, Eurographics 2024), so that a test can check a kernel
against the step it implements.

stretch    stretch tensor of every triangle (section 2.2), clamp, calibration percentile
stretch_models   the models that the paper compares with: mesh tension, and along u and v
locate     which triangle a point of the UV plane takes its values from, and how sure that is
response   widths and depths of wrinkles (Alg. 1) and pores (Alg. 2)
drawing    profiles, and how heights meet in a displacement map
waves      wrinkles that run to and fro across their segments
redraw     a graph under stretch, drawn anew (section 2.3)
bins       the fast method: quantised maps by angle and stretch, blended (section 2.4, Alg. 3)
folding    what folds of a mesh take of its log compression
stiffness  a painted map at texels and elements
convolve   the neutral map blurred and sharpened along the axes of stretch (Nagano et al. 2015)
pyramid    levels of a map
inputs     the records that go in; the product's own graph and settings have the same fields
boxes      finding points in a box
"""
