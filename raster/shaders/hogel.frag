#version 450 core
// Triangle number, camera number and radiance of a pixel.
//
// FRAGMENT_DEPTH, if defined, is an expression in w, near and far for a depth mapping that the
// hardware does not interpolate. SHADED enables lighting; NUMBERED draws only identities.

#include "triangle.glsl"
#ifdef SHADED
#include "surface.glsl"
#include "phong.glsl"
#endif

layout(location = 0) out uvec2 identity;
#ifndef NUMBERED
layout(location = 1) out vec4 radiance;
#endif

uniform uint camera;  // number of the camera in drawing order

#ifdef FRAGMENT_DEPTH
uniform float near;
uniform float far;
#endif

void main() {
    identity = uvec2(uint(TRIANGLE) + 1u, camera);
#ifdef FRAGMENT_DEPTH
    float w = 1.0 / gl_FragCoord.w;
    gl_FragDepth = FRAGMENT_DEPTH;
#endif
#ifdef SHADED
    radiance = vec4(lit(TRIANGLE), 1.0);
#elif !defined(NUMBERED)
    radiance = vec4(0.0);
#endif
}
