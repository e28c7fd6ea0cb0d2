#version 450 core
// Surface points of pixels: intersections of the triangle's plane and the camera's line through the
// pixel's center, by homogeneous barycentric coordinates in double precision.
//
// A varying would be accurate enough for a picture, but not for a measurement. Drivers interpolate
// with plane equations in float32, some from snapped vertices: on triangles that are slivers in the
// image, points are then wrong by hundredths of a pixel (docs/adr/0005).

layout(local_size_x = 256) in;

layout(binding = 0) uniform usampler2D identities;

layout(std430, binding = 1) readonly buffer Vertices { double vertices[]; };
layout(std430, binding = 2) readonly buffer Faces { uint faces[]; };
layout(std430, binding = 3) writeonly buffer Points { float points[]; };
layout(std430, binding = 4) readonly buffer Pixels { uint pixels[]; };  // by rows from the top

uniform uint camera;  // number of the camera; points of other cameras are not changed
uniform dmat4 clip_from_scene;
uniform vec2 cuts;      // lowest and highest z of the camera
uniform float nothing;  // NaN
uniform int count;      // number of pixels; all x, then all y, then all z are written

dvec3 corner(uint triangle, uint k) {
    uint first = 3u * faces[3u * triangle + k];
    return dvec3(vertices[first], vertices[first + 1u], vertices[first + 2u]);
}

void main() {
    int place = int(gl_GlobalInvocationID.x);
    if (place >= count) return;
    ivec2 size = textureSize(identities, 0);
    int number = int(pixels[place]);
    // OpenGL counts rows from the bottom.
    ivec2 pixel = ivec2(number % size.x, size.y - 1 - number / size.x);

    uvec2 identity = texelFetch(identities, pixel, 0).rg;
    if (identity.g != camera) return;
    vec3 point = vec3(nothing);
    if (identity.r != 0u) {
        uint triangle = identity.r - 1u;
        dvec3 p0 = corner(triangle, 0u), p1 = corner(triangle, 1u), p2 = corner(triangle, 2u);
        dvec3 c0 = (clip_from_scene * dvec4(p0, 1.0)).xyw;
        dvec3 c1 = (clip_from_scene * dvec4(p1, 1.0)).xyw;
        dvec3 c2 = (clip_from_scene * dvec4(p2, 1.0)).xyw;
        // Line through the pixel's center in homogeneous clip coordinates (x, y, w).
        dvec3 line = dvec3((2.0LF * dvec2(pixel) + 1.0LF) / dvec2(size) - 1.0LF, 1.0LF);
        dvec3 weight = dvec3(dot(line, cross(c1, c2)), dot(line, cross(c2, c0)), dot(line, cross(c0, c1)));
        double total = weight.x + weight.y + weight.z;
        // Add offsets to the first corner, so that points of small, distant triangles keep all
        // digits. A triangle seen exactly edge-on has no such point, and its first corner is used.
        point = vec3(total != 0.0LF ? p0 + (weight.y * (p1 - p0) + weight.z * (p2 - p0)) / total : p0);
        // Because of subpixel rounding, a triangle is drawn up to a fraction of a pixel beyond its
        // cuts by the near and far plane. Such pixels show the cut.
        point.z = clamp(point.z, cuts.x, cuts.y);
    }
    points[place] = point.x;
    points[place + count] = point.y;
    points[place + 2 * count] = point.z;
}
