// Slopes of the heights of a frame, and their products, texel by texel: what the levels of both textures
// are means of (Olano and Baker 2010, "LEAN mapping"). Where there is no skin all is 0, the last number
// too; it is 1 elsewhere, and what is read of a level is divided by it. docs/package.md, "Shine".

uniform sampler2D rhytid_heights; // of the frame, the target of the pass height, R32F
uniform usampler2DArray rhytid_triangles; // the triangle of each texel

// Height of a texel and 1; zeros where there is no skin or no texel.
vec2 rhytid_drawn(ivec2 texel)
{
    if (min(texel.x, texel.y) < 0 || max(texel.x, texel.y) >= RHYTID_RESOLUTION) {
        return vec2(0.0, 0.0);
    }
    ivec2 part = texel / RHYTID_PAGE;
    int page = part.y * RHYTID_PAGES_A_ROW + part.x;
    int face = rhytid_number(rhytid_triangles, texel - part * RHYTID_PAGE, page);
    if (face == RHYTID_TRIANGLES) {
        return vec2(0.0, 0.0);
    }
    return vec2(rhytid_load(rhytid_heights, texel).x, 1.0);
}

// Half the difference of both neighbours, or the whole one to that which is there, mesh units.
float rhytid_rise(ivec2 texel, ivec2 way, float height)
{
    vec2 next = rhytid_drawn(texel + way);
    vec2 last = rhytid_drawn(texel - way);
    float rise = next.y * (next.x - height) + last.y * (height - last.x);
    return rise / max(next.y + last.y, 1.0);
}

// By column and by row, in parts of RHYTID_SLOPE_UNIT mesh units over the side of the map.
vec3 rhytid_slope_of(ivec2 texel)
{
    vec2 here = rhytid_drawn(texel);
    float right = rhytid_rise(texel, ivec2(1, 0), here.x);
    float down = rhytid_rise(texel, ivec2(0, 1), here.x);
    float unit = here.y * float(RHYTID_RESOLUTION) / RHYTID_SLOPE_UNIT;
    return vec3(unit * right, unit * down, here.y);
}
