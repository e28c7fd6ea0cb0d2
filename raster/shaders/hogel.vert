#version 450 core
// One camera, C or C*: which one is in the matrix alone.

uniform mat4 clip_from_scene;

in vec3 in_position;  // scene units

// Programs with other effects, and the reflection pass, must meet the same pixels.
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
}
