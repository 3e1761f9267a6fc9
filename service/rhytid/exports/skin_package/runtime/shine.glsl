// Roughness along and across, its axis, and the mean slope under a pixel, from the textures of slopes and
// of their products (Olano and Baker 2010, "LEAN mapping"; Dupuy et al. 2013, "LEADR mapping"). docs/shine.md
// has the formulas and what each shader makes of the roughness.

struct RhytidShine {
    vec2 slope; // mean, along T and B: the normal is (-x, -y, 1)
    vec2 roughness; // along the axis and across it, the smaller one
    vec2 axis; // a unit vector along T and B, its first part not negative
};

// slopes, products: as a filtered texture has them. along_u, along_v: the gradients of u and v (v down) on
// the surface, along T and B, per mesh unit. roughness: of skin without relief.
RhytidShine rhytid_shine(vec4 slopes, vec4 products, vec2 along_u, vec2 along_v, float roughness)
{
    float unit = RHYTID_SLOPE_UNIT / max(slopes.w, 1e-3);
    float more = RHYTID_SLOPE_UNIT * RHYTID_SLOPE_UNIT / max(products.w, 1e-3);
    vec2 mean = vec2(unit * slopes.x, unit * slopes.y);
    float uu = max(more * products.x - mean.x * mean.x, 0.0);
    float uv = more * products.y - mean.x * mean.y;
    float vv = max(more * products.z - mean.y * mean.y, 0.0);
    vec2 by_u = uu * along_u + uv * along_v;
    vec2 by_v = uv * along_u + vv * along_v;
    float xx = by_u.x * along_u.x + by_v.x * along_v.x;
    float xy = by_u.x * along_u.y + by_v.x * along_v.y;
    float yy = by_u.y * along_u.y + by_v.y * along_v.y;
    float middle = 0.5 * (xx + yy);
    float apart = 0.5 * (xx - yy);
    float size = sqrt(apart * apart + xy * xy);
    float own = roughness * roughness * roughness * roughness;
    RhytidShine found;
    found.slope = mean.x * along_u + mean.y * along_v;
    // A roughness is the fourth root of alpha squared.
    float first = sqrt(min(own + 2.0 * max(middle + size, 0.0), 1.0));
    float second = sqrt(min(own + 2.0 * max(middle - size, 0.0), 1.0));
    found.roughness = vec2(sqrt(first), sqrt(second));
    // The axis has half the angle of (apart, xy).
    float turn = apart / max(size, 1e-30);
    float side = sqrt(max(0.5 - 0.5 * turn, 0.0));
    if (xy < 0.0) {
        side = -side;
    }
    found.axis = vec2(sqrt(max(0.5 + 0.5 * turn, 0.0)), side);
    if (size < 1e-20) {
        found.axis = vec2(1.0, 0.0);
    }
    return found;
}
