#version 450 core
// One camera, C or C*: they differ only in the matrix.
//
// NUMBERED draws a mesh in which the number of a triangle is the number of its last vertex
// (mesh.py). MANY implies the same, and is the largest number of hogels in one submission.
// WITH_LAYERS draws each hogel into its own layer, if the device lets vertex shaders select layers;
// without it, a submission has one hogel.

#ifdef WITH_LAYERS
#extension GL_ARB_shader_viewport_layer_array : require
#endif

#ifdef MANY
#include "hogels.glsl"
in uint in_hogel;
#define clip_from_scene hogels[in_hogel].clip_from_scene

// gl_PrimitiveID is not used: it restarts with every draw, and with it Mesa's software pipeline
// processes three vertices per triangle. Here a triangle has the number of its last vertex.
flat out int numbered;
flat out uint hogel;

// Normal and material of the triangle whose last corner is this vertex, see surface.glsl.
in vec3 in_flat_normal;
in uvec2 in_flat_surface;
flat out vec3 flat_normal;
flat out uvec2 flat_surface;
#else
uniform mat4 clip_from_scene;
#ifdef NUMBERED
flat out int numbered;
#endif
#endif

in vec3 in_position;  // scene units

// Programs for other effects, for many hogels and for reflections must cover the same pixels.
invariant gl_Position;

// Interpolate at a point inside the triangle (`centroid`): with several coverage samples, a pixel's
// center may be outside the triangle, where interpolated colors can be negative. With one sample,
// the point is the center.

#ifdef SMOOTH_NORMALS
in vec3 in_normal;
centroid out vec3 smooth_normal;
#endif
#ifdef VERTEX_COLORS
in vec3 in_color;  // linear RGB
centroid out vec3 vertex_color;
#endif
#ifdef TEXTURES
in vec2 in_uv;  // v up
centroid out vec2 uv;
#endif

void main() {
    gl_Position = clip_from_scene * vec4(in_position, 1.0);
#ifdef SMOOTH_NORMALS
    smooth_normal = in_normal;
#endif
#ifdef VERTEX_COLORS
    vertex_color = in_color;
#endif
#ifdef TEXTURES
    uv = in_uv;
#endif
#if defined(MANY) || defined(NUMBERED)
    numbered = gl_VertexID;
#endif
#ifdef MANY
    hogel = in_hogel;
    flat_normal = in_flat_normal;
    flat_surface = in_flat_surface;
#ifdef WITH_LAYERS
    gl_Layer = int(in_hogel);
#endif
#endif
}
