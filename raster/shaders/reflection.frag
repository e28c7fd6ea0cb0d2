#version 450 core
// Radiance that a reflective surface adds to its pixel, in a separate pass per camera (paper,
// section 6).
//
// The visible triangle of a pixel and its camera are looked up in the identities of the finished
// picture. A depth test for equality would add the reflections of all surfaces that tie; a pixel
// has one identity.

#include "triangle.glsl"
#include "surface.glsl"
#include "environment.glsl"

layout(location = 0) out vec4 radiance;  // added to the picture

#ifdef MULTISAMPLED
layout(binding = 0) uniform usampler2DMS identities;
#elif defined(MANY)
layout(binding = 0) uniform usampler2DArray identities;
#else
layout(binding = 0) uniform usampler2D identities;
#endif

uniform uint camera;
#ifdef MULTISAMPLED
uniform int sample_count;
#endif

// Mask of the samples of the pixel that show this triangle, drawn by this camera; one bit per
// sample.
int shown(int triangle) {
    uvec2 identity = uvec2(uint(triangle) + 1u, camera);
    ivec2 pixel = ivec2(gl_FragCoord.xy);
#ifdef MULTISAMPLED
    int mask = 0;
    for (int i = 0; i < sample_count; i++)
        if (texelFetch(identities, pixel, i).rg == identity) mask |= 1 << i;
    return mask;
#elif defined(MANY)
    return int(texelFetch(identities, ivec3(pixel, hogel), 0).rg == identity);
#else
    return int(texelFetch(identities, pixel, 0).rg == identity);
#endif
}

void main() {
    int triangle = TRIANGLE;
    int mask = shown(triangle);
    if (mask == 0) discard;
#ifdef MULTISAMPLED
    gl_SampleMask[0] = mask;
#endif
    // The direction C* is opposite to the eye's direction, and so is its reflection R*: the viewer
    // sees the environment along -R*.
    vec3 N_star = turned_to_camera(triangle);
    vec3 C_star = toward_camera();
    vec3 R = conjugate * reflected(C_star, N_star);
    precise vec3 reflection = materials[SURFACE_OF(triangle).x & MATERIAL].reflectance.rgb * environment_along(R);
    radiance = vec4(flushed(reflection), 0.0);
}
