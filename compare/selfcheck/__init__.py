"""The truth against brute force in integers.

boxes          Which triangles cannot matter to a line: it misses the box about them, by a wide margin
disagreements  Where does a traced image differ from what integers say? Triangle, class, companions,
               position
rational       The truth once more, by brute force in integers, to check the reference with
selfcheck      Is the truth true? The reference against integer brute force, pixel by pixel
sphere         A closed mesh about a point: no line through the point may miss it, least of all at its
               corners
views          What `selfcheck` looks at: scenes, apertures, and images small enough for integers
"""
