// Phong model without reflections. A term is computed only if its name is defined. Any other term
// would add zero to the pictures of this scene.

#ifdef TEXTURES
#include "texture.glsl"
centroid in vec2 uv;
#endif
#ifdef VERTEX_COLORS
centroid in vec3 vertex_color;
#endif

struct Light {
    vec4 toward;  // unit
    vec4 color;
};
#ifdef LIGHT_COUNT
layout(std140, binding = 2) uniform Lights { Light lights[LIGHT_COUNT]; };
#else
layout(std430, binding = 8) readonly buffer Lights { Light lights[]; };
#endif
uniform int light_count;

vec3 albedo_of(uvec2 surface) {
    precise vec3 albedo = vec3(1.0);
#ifdef VERTEX_COLORS
    if ((surface.x & IS_COLORED) != 0u) albedo *= vertex_color;
#endif
#ifdef TEXTURES
    if (surface.y != 0u) albedo *= texture_color(surface.y - 1u, uv);
#endif
    return albedo;
}

vec3 lit(int triangle) {
    uvec2 surface = SURFACE_OF(triangle);
    Material material = materials[surface.x & MATERIAL];
    precise vec3 albedo = albedo_of(surface);
    precise vec3 radiance = vec3(0.0);
#ifdef AMBIENT
    radiance += material.ambient.rgb * albedo;
#endif
#if defined(DIFFUSE) || defined(SPECULAR)
    vec3 N_star = turned_to_camera(triangle);
    vec3 C_star = toward_camera();
    vec3 R_star = reflected(C_star, N_star);
    for (int i = 0; i < light_count; i++) {
        precise vec3 L_star = conjugate * lights[i].toward.xyz;
        vec3 color = lights[i].color.rgb;
        precise float facing = dot(N_star, L_star);
#ifdef DIFFUSE
        radiance += color * (material.diffuse.rgb * albedo * max(facing, 0.0));
#endif
#ifdef SPECULAR
        precise float mirrored = dot(R_star, L_star);
        precise float highlight = facing > 0.0 ? power(mirrored, material.specular.w) : 0.0;
        radiance += color * (material.specular.rgb * highlight);
#endif
    }
#endif
    return flushed(radiance);
}
