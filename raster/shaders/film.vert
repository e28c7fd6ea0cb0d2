#version 450 core
// A triangle over the whole film of each hogel.

#ifdef WITH_LAYERS
#extension GL_ARB_shader_viewport_layer_array : require
#endif

flat out uint hogel;

void main() {
    gl_Position = vec4(4.0 * vec2(gl_VertexID & 1, gl_VertexID >> 1) - 1.0, 0.0, 1.0);
    hogel = uint(gl_InstanceID);
#ifdef WITH_LAYERS
    gl_Layer = gl_InstanceID;
#endif
}
