#version 450 core
// What a pixel shows: which triangle, drawn by which camera, in which light.
//
// FRAGMENT_DEPTH, where it is defined, is an expression in w, near and far: a depth mapping that
// the hardware does not interpolate.

layout(location = 0) out uvec2 identity;
layout(location = 1) out vec4 radiance;

// Unit normals by the mesh's winding, three floats a triangle.
layout(std430, binding = 0) readonly buffer Normals { float normals[]; };

#ifdef MANY
flat in int numbered;  // see hogel.vert
#define TRIANGLE numbered
#else
#define TRIANGLE gl_PrimitiveID
#endif

uniform uint camera;  // its number in drawing order

#ifdef FRAGMENT_DEPTH
uniform float near;
uniform float far;
#endif

// Toward the light for C. For C* the pseudoscopic light L*: the same light from the opposite
// direction (paper, section 3, figure 3).
uniform vec3 light;
uniform float albedo;
uniform float ambient;

void main() {
    identity = uvec2(uint(TRIANGLE) + 1u, camera);
#ifdef FRAGMENT_DEPTH
    float w = 1.0 / gl_FragCoord.w;
    gl_FragDepth = FRAGMENT_DEPTH;
#endif

    int first = 3 * TRIANGLE;
    vec3 normal = vec3(normals[first], normals[first + 1], normals[first + 2]);
    // N is flipped for surfaces that are turned away from the camera. For C* these are the ones
    // that face the viewer: N* and L* are both reversed there, and their product is not.
    vec3 facing_camera = gl_FrontFacing ? normal : -normal;
    float lambert = ambient + (1.0 - ambient) * max(dot(facing_camera, light), 0.0);
    radiance = vec4(vec3(albedo * lambert), 1.0);
}
