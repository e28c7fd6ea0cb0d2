"""Many hogels at once: the same pictures in fewer submissions.

clusters    Clusters of triangles that a hogel's frusta cannot see, found before anything is drawn
geometry    A scene as all hogels of a plate share it: on the GPU once, sorted by the cameras that see it
one_by_one  Hogels one after the other, for scenes that ask for several samples a pixel, and means of hogels
picture     The pictures of several hogels: programs, draws, submissions, and reflections over them
plain_loop  What drawing many hogels at once is measured against: one hogel after the other
renderer    Many hogels per submission: the paper's double frustum for a whole plate, as a stream
targets     Framebuffers with a layer for each of several hogels, and their way back to the processor
"""
