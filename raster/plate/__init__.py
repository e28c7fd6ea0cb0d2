"""Many hogels at once: the same pictures in fewer submissions.

clusters    Triangles as all hogels of a plate share them, in clusters that a hogel may leave out
one_by_one  Hogels one after the other: several samples a pixel, means, and the plain loop to
measure against picture     The pictures of several hogels: programs, draws, submissions, and
reflections over them renderer    Many hogels per submission: the paper's double frustum for a whole
plate, as a stream targets     Framebuffers with a layer for each of several hogels, and their way
back to the processor
"""
