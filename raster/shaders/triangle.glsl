// Which of the scene's triangles a fragment belongs to.
#if defined(MANY) || defined(NUMBERED)
flat in int numbered;  // see hogel.vert
#define TRIANGLE numbered
#else
uniform int first_triangle;  // of those drawn
#define TRIANGLE (first_triangle + gl_PrimitiveID)
#endif
