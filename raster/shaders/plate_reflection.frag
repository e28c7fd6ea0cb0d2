#version 450 core
// What mirror-like surfaces add to their pixels: a pass of its own per camera (paper, section 6).
//
// Which triangle a pixel shows, and which camera drew it, is decided by then and looked up.

#include "hogels.glsl"

layout(location = 0) out vec4 radiance;  // added to what is there

layout(std430, binding = 0) readonly buffer Normals { float normals[]; };

layout(binding = 0) uniform usampler2DArray identities;
layout(binding = 1) uniform sampler2D environment;  // latitude and longitude; its middle behind the plate

uniform uint camera;  // its number in drawing order
uniform float conjugate;  // 1 for C, -1 for C*
uniform vec2 pixels;

flat in int numbered;
flat in uint hogel;

const float PI = 3.14159265358979;

void main() {
    uvec2 shown = texelFetch(identities, ivec3(gl_FragCoord.xy, hogel), 0).rg;
    if (shown != uvec2(uint(numbered) + 1u, camera)) discard;
    vec3 away = hogels[hogel].line_of_pixel * vec3(2.0 * gl_FragCoord.xy / pixels - 1.0, 1.0);
    vec3 normal = vec3(normals[3 * numbered], normals[3 * numbered + 1], normals[3 * numbered + 2]);
    // C* looks back at the viewer: what the viewer sees mirrored lies the other way.
    vec3 mirrored = normalize(reflect(away, normal)) * conjugate;
    vec2 at = vec2(0.5 + atan(mirrored.x, -mirrored.z) / (2.0 * PI), 0.5 - asin(mirrored.y) / PI);
    radiance = vec4(texture(environment, at).rgb, 0.0);
}
