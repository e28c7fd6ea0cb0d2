// Textures, filtered by this code: hardware filters weight texels in steps of 1/256.

// RGBA with 8 bits per channel, all textures one after the other, rows from the top.
layout(std430, binding = 9) readonly buffer Texels { uint texels[]; };
// First texel, width and height of each texture.
layout(std430, binding = 10) readonly buffer Places { uvec4 places[]; };
// Linear light of each of the 256 codes of sRGB.
layout(std430, binding = 11) readonly buffer Decoded { float decoded[256]; };

vec3 texel(uvec4 place, ivec2 at) {
    uint code = texels[place.x + uint(at.y) * place.y + uint(at.x)];
    return vec3(decoded[code & 255u], decoded[(code >> 8) & 255u], decoded[(code >> 16) & 255u]);
}

// Decode, then interpolate bilinearly between texel centers. Textures repeat; v points up, rows
// count down.
vec3 texture_color(uint number, vec2 uv) {
    uvec4 place = places[number];
    ivec2 size = ivec2(place.yz);
    precise vec2 repeated = uv - floor(uv);
    precise vec2 at = vec2(repeated.x, 1.0 - repeated.y) * vec2(size) - 0.5;
    precise vec2 below = floor(at);
    precise vec2 share = at - below;
    ivec2 low = (ivec2(below) + size) % size;
    ivec2 high = (ivec2(below) + 1) % size;
    precise vec3 upper = texel(place, low) * (1.0 - share.x) + texel(place, ivec2(high.x, low.y)) * share.x;
    precise vec3 lower = texel(place, ivec2(low.x, high.y)) * (1.0 - share.x) + texel(place, high) * share.x;
    precise vec3 color = upper * (1.0 - share.y) + lower * share.y;
    return color;
}
