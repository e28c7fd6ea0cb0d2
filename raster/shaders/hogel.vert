#version 450 core
// One camera, C or C*: which one is in the matrix alone.
//
// MANY draws up to so many hogels in one submission, each on a layer of its own; WITH_LAYERS where the
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
#else
uniform mat4 clip_from_scene;
#endif

in vec3 in_position;  // scene units

// The programs for one hogel, for many and for reflections must meet the same pixels.
invariant gl_Position;

void main() {
    gl_Position = clip_from_scene * vec4(in_position, 1.0);
#ifdef MANY
    numbered = gl_VertexID;
    hogel = in_hogel;
#ifdef WITH_LAYERS
    gl_Layer = int(in_hogel);
#endif
#endif
}
