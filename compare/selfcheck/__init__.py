"""The truth against brute force in integers.

boxes          Boxes that rule out triangles: a line that misses a triangle's box misses the triangle
disagreements  Pixels in which a traced image differs from the integers' answer: triangle, class,
               companions, position
rational       The truth once more, by brute force in integers, to check the reference with
selfcheck      Is the truth true? The reference against integer brute force, pixel by pixel
sphere         A closed mesh about a point: no line through the point may miss it, least of all at its
               corners
views          The views that `selfcheck` checks: scenes, apertures, and images small enough for integers
"""
