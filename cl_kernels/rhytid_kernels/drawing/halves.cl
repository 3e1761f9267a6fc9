// Sixteen numbers as the bits of half floats, rounded to even. A number is added to the power of two whose last bit
// is that of its half float: the addition of floats rounds by itself. vstore_half takes one number after the other.
// Those that half floats cannot hold, and what is no number, become infinite.
__kernel void half_floats(__global const float *values, __global short *codes)
{
    const int i = get_global_id(0);
    const float16 value = vload16(i, values);
    const float16 size = fmin(fabs(value), 65536.0f);
    const int16 sign = (as_int16(value) >> 16) & 0x8000;
    // The exponent of the least normal half float at least, and of the power that is added 13 more.
    const int16 power = max(as_int16(size) & 0x7f800000, 113 << 23) + (13 << 23);
    const int16 rounded = as_int16(size + as_float16(power)) - power;
    // Of a number that was rounded up to a power of two the mantissa overflows into the exponent.
    vstore16(convert_short16((rounded + (power >> 13) - (126 << 10)) | sign), i, codes);
}
