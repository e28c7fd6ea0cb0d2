#version 450 core
// Light where it is decided what each pixel shows: once a pixel, however many triangles met it. Only what
// belongs to whole triangles can be looked up here; what is interpolated over them is gone.

bool turned;  // whether the triangle's front is turned to the camera
#define FRONT_FACING turned
#include "turned.glsl"
#include "surface.glsl"
#include "phong.glsl"

layout(location = 0) out vec4 radiance;

layout(binding = 0) uniform usampler2DArray identities;
uniform uint camera;

void main() {
    uvec2 identity = texelFetch(identities, ivec3(gl_FragCoord.xy, hogel), 0).rg;
    if (identity.x == 0u || (identity.y & ~TURNED) != camera) discard;
    turned = (identity.y & TURNED) != 0u;
    radiance = vec4(lit(int(identity.x) - 1), 1.0);
}
