// The vectors of a surface as a camera has them (paper, section 3, figure 3).
//
// An orthoscopic camera shades with N, E and L. The pseudoscopic camera C* looks back at the viewer, who
// sees the other side of what the camera is turned to. All three vectors are reversed for it:
//
//     N* = -N    the surface's orientation: turned to the camera, as for every surface
//     C* = -E    the direction of the camera, where E is that of the viewer
//     L* = -L    the pseudoscopic light: as strong, from the opposite direction
//
// so that N*.L*, N*.C* and R*.L* are N.L, N.E and R.L. The names with a star are those of C*; for C
// the same lines compute N, E, L and R themselves.

#include "accurate.glsl"

// Of each triangle: its unit normal by the mesh's winding; the number of its material with two flags,
// and that of its texture + 1.
#ifdef MANY
flat in vec3 flat_normal;  // see hogel.vert: what vertices carry costs less than looking it up
flat in uvec2 flat_surface;
#define NORMAL_OF(triangle) flat_normal
#define SURFACE_OF(triangle) flat_surface
#else
layout(std430, binding = 0) readonly buffer Normals { float normals[]; };
layout(std430, binding = 6) readonly buffer Surfaces { uvec2 surfaces[]; };
#define NORMAL_OF(triangle) vec3(normals[3 * triangle], normals[3 * triangle + 1], normals[3 * triangle + 2])
#define SURFACE_OF(triangle) surfaces[triangle]
#endif

const uint IS_SMOOTH = 1u << 31;   // all three corners have normals of their own
const uint IS_COLORED = 1u << 30;  // a corner's color is another than one, which does not multiply
const uint MATERIAL = IS_COLORED - 1u;

struct Material {
    vec4 ambient;
    vec4 diffuse;
    vec4 specular;     // and in w the exponent
    vec4 reflectance;  // reflectivity times the environment's strength
};
#ifdef MATERIAL_COUNT
layout(std140, binding = 1) uniform Materials { Material materials[MATERIAL_COUNT]; };
#else  // too many for a uniform block, which costs less
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
uniform vec2 pixels;         // of the image

#ifdef SMOOTH_NORMALS
centroid in vec3 smooth_normal;
#endif

// E for C, and for C* the camera's direction instead of the eye's. It is constant along the line through
// the pixel's center, and taken from that: the same direction as from the surface point drawn there.
vec3 toward_camera() {
    precise vec2 film = 2.0 * gl_FragCoord.xy / pixels - 1.0;
    precise vec3 away = line_of_pixel * vec3(film, 1.0);
    return -unit(away);
}

// N for C, and N* for C*: OpenGL finds the faces that are turned away from the camera, and they are
// flipped. For C* these are the ones that face the viewer.
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
