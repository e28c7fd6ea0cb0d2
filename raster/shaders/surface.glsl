// Vectors of a surface for the shading by C or C* (paper, section 3, figure 3).
//
// The orthoscopic camera C shades with N, E and L. The pseudoscopic camera C* looks back at the
// viewer, and the viewer sees the other side of the surface. All three vectors are reversed for C*:
//
//     N* = -N    the normal is turned to the camera, as for every surface
//     C* = -E    direction to the camera; E is the direction to the viewer
//     L* = -L    pseudoscopic light: the same strength from the opposite direction
//
// Therefore N*.L*, N*.C* and R*.L* are equal to N.L, N.E and R.L. Names with a star are the vectors
// of C*; for C the same code computes N, E, L and R.

#include "accurate.glsl"

// For each triangle: unit normal by the mesh's winding; material number with two flags, and texture
// number + 1.
#ifdef MANY
flat in vec3 flat_normal;  // see hogel.vert: a varying costs less than a look-up
flat in uvec2 flat_surface;
#define NORMAL_OF(triangle) flat_normal
#define SURFACE_OF(triangle) flat_surface
#else
layout(std430, binding = 0) readonly buffer Normals { float normals[]; };
layout(std430, binding = 6) readonly buffer Surfaces { uvec2 surfaces[]; };
#define NORMAL_OF(triangle) vec3(normals[3 * triangle], normals[3 * triangle + 1], normals[3 * triangle + 2])
#define SURFACE_OF(triangle) surfaces[triangle]
#endif

const uint IS_SMOOTH = 1u << 31;   // all three corners have vertex normals
const uint IS_COLORED = 1u << 30;  // a corner's color is not one; a color of one would change nothing
const uint MATERIAL = IS_COLORED - 1u;

struct Material {
    vec4 ambient;
    vec4 diffuse;
    vec4 specular;     // the exponent is in w
    vec4 reflectance;  // reflectivity times the environment's strength
};
#ifdef MATERIAL_COUNT
layout(std140, binding = 1) uniform Materials { Material materials[MATERIAL_COUNT]; };
#else  // too many materials for a uniform block, which costs less than a storage block
layout(std430, binding = 7) readonly buffer Materials { Material materials[]; };
#endif

uniform float conjugate;     // 1 for C, -1 for C*
#ifdef MANY
#include "hogels.glsl"
flat in uint hogel;
#define line_of_pixel hogels[hogel].line_of_pixel
#else
uniform mat3 line_of_pixel;  // from film coordinates to the direction away from the camera, scene axes
#endif
uniform vec2 pixels;         // width and height of the image

#ifdef SMOOTH_NORMALS
centroid in vec3 smooth_normal;
#endif

// Direction to the camera: E for C, C* for C*. It is constant along the line through the pixel's
// center, and is computed from that line: it is also the direction from the surface point drawn at
// the pixel.
vec3 toward_camera() {
    precise vec2 film = 2.0 * gl_FragCoord.xy / pixels - 1.0;
    precise vec3 away = line_of_pixel * vec3(film, 1.0);
    return -unit(away);
}

// N for C, and N* for C*: normals of faces that are turned away from the camera are flipped. For C*
// these faces are turned toward the viewer.
vec3 turned_to_camera(int triangle) {
    precise vec3 normal = NORMAL_OF(triangle);
#ifdef SMOOTH_NORMALS
    bool smoothed = (SURFACE_OF(triangle).x & IS_SMOOTH) != 0u && dot(smooth_normal, smooth_normal) > 0.0;
    if (smoothed) normal = unit(smooth_normal);
#endif
    return gl_FrontFacing ? normal : -normal;
}

// R: a direction reflected across a normal.
vec3 reflected(vec3 direction, vec3 normal) {
    precise vec3 mirrored = 2.0 * dot(normal, direction) * normal - direction;
    return mirrored;
}
