// Number of the scene's triangle to which a fragment belongs.
#if defined(MANY) || defined(NUMBERED)
flat in int numbered;  // see hogel.vert
#define TRIANGLE numbered
#else
uniform int first_triangle;  // first triangle of the draw
#define TRIANGLE (first_triangle + gl_PrimitiveID)
#endif
