"""Many hogels at once: the same pictures in fewer submissions.

clusters     What a hogel's frusta cannot see: clusters of triangles, tested before anything is drawn
drawing      One program over the triangles that it is for, drawn by each camera for many hogels at once
geometry     A scene as all hogels of a plate share it: on the GPU once, sorted by the cameras that can
             see it
picture      What several hogels show: every camera's picture and, over all of them, every camera's
             reflections
plain_loop   What drawing many hogels at once is measured against: one hogel after the other, all
             triangles twice
program      The programs that draw many hogels at once: the same shaders as for one
reflection   Mirror-like surfaces of many hogels at once: a pass of its own per camera (paper, section 6)
renderer     Many hogels per submission: the paper's double frustum for a whole plate, as a stream
submissions  How many hogels are drawn at once, and what each submission owns while it is on its way
targets      Framebuffers with a layer for each of several hogels, and their way back to the processor
"""
