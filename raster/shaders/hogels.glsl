// Matrices of each hogel.

struct Hogel {
    mat4 clip_from_scene;
    mat3 line_of_pixel;  // from film coordinates to the direction away from the camera, scene axes
};
layout(std140, binding = 0) uniform Hogels { Hogel hogels[MANY]; };
