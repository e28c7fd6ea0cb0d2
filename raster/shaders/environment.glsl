// Latitude-longitude map: its middle is behind the plate (-z), its top is +y, and +x is to the
// right.

layout(binding = 1) uniform sampler2D environment;  // row 0 at the top

// Interpolate bilinearly between texel centers; longitude wraps around, latitude is clamped at the
// poles.
vec3 environment_along(vec3 direction) {
    ivec2 size = textureSize(environment, 0);
    precise float longitude = angle_of(-direction.z, direction.x);
    precise float latitude = angle_of(sqrt(dot(direction.xz, direction.xz)), direction.y);
    precise vec2 at = vec2(0.5 + longitude / (2.0 * PI), 0.5 - latitude / PI) * vec2(size) - 0.5;
    precise vec2 below = floor(at);
    precise vec2 share = at - below;
    int left = (int(below.x) + size.x) % size.x;
    int right = (int(below.x) + 1) % size.x;
    ivec2 rows = clamp(ivec2(below.y, below.y + 1.0), 0, size.y - 1);
    precise vec3 upper = texelFetch(environment, ivec2(left, rows.x), 0).rgb * (1.0 - share.x)
        + texelFetch(environment, ivec2(right, rows.x), 0).rgb * share.x;
    precise vec3 lower = texelFetch(environment, ivec2(left, rows.y), 0).rgb * (1.0 - share.x)
        + texelFetch(environment, ivec2(right, rows.y), 0).rgb * share.x;
    precise vec3 radiance = upper * (1.0 - share.y) + lower * share.y;
    return radiance;
}
