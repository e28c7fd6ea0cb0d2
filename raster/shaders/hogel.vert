#version 450 core
// One camera, C or C*: which one is in the matrix alone.

uniform mat4 clip_from_scene;

in vec3 in_position;  // scene units

void main() {
    gl_Position = clip_from_scene * vec4(in_position, 1.0);
}
