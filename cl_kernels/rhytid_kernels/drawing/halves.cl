// Numbers as the bits of half floats, rounded to even. A number is added to the power of two whose last bit is that of
// its half float: the addition of floats rounds by itself. vstore_half takes one number after the other. Those that half
// floats cannot hold, and what is no number, become infinite.
static short16 half_bits(const float16 value)
{
    const float16 size = fmin(fabs(value), 65536.0f);
    const int16 sign = (as_int16(value) >> 16) & 0x8000;
    // The exponent of the least normal half float at least, and of the power that is added 13 more.
    const int16 power = max(as_int16(size) & 0x7f800000, 113 << 23) + (13 << 23);
    const int16 rounded = as_int16(size + as_float16(power)) - power;
    // Of a number that was rounded up to a power of two the mantissa overflows into the exponent.
    return convert_short16((rounded + (power >> 13) - (126 << 10)) | sign);
}

// Sixteen numbers.
__kernel void half_floats(__global const float *values, __global short *codes)
{
    const int i = get_global_id(0);
    vstore16(half_bits(vload16(i, values)), i, codes);
}

// Sixteen numbers of a row of a square in a larger one, to a row of another square: where the first number of each lies,
// and how far the rows are apart. Work-items: vectors of a row, rows.
__kernel void half_square(
    __global const float *values, const int from, const int from_row,
    const int to, const int to_row, __global short *codes)
{
    const int at = 16 * get_global_id(0), row = get_global_id(1);
    const short16 found = half_bits(vload16(0, values + from + row * from_row + at));
    vstore16(found, 0, codes + to + row * to_row + at);
}
