#version 450 core
// One camera, C or C*: which one is in the matrix alone.
//
// NUMBERED draws a mesh whose triangles have the numbers of their last vertices, see mesh.py.
// MANY does so, too, and draws up to so many hogels in one submission, each on a layer of its own; WITH_LAYERS where the
// device lets a vertex choose its layer. Otherwise there is one hogel at a time.

#ifdef WITH_LAYERS
#extension GL_ARB_shader_viewport_layer_array : require
#endif

#ifdef MANY
#include "hogels.glsl"
in uint in_hogel;
#define clip_from_scene hogels[in_hogel].clip_from_scene

// gl_PrimitiveID would start again with every draw, and Mesa's software pipeline takes triangles apart
// for it. Here a triangle has the number of its last vertex.
flat out int numbered;
flat out uint hogel;

// What belongs to the triangle that a vertex ends, see surface.glsl.
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

// Programs with other effects, for many hogels and for reflections must meet the same pixels.
invariant gl_Position;

// Interpolated at a point within the triangle: with several coverage samples a pixel's center may lie
// outside, where colors can be negative. With one sample it is the center.

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
