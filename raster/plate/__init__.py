"""Many hogels at once: the same pictures in fewer submissions.

averaging    Hogels averaged over sub-apertures, from a stream of single images (paper, section 6: band
             limiting)
clusters     Clusters of triangles that a hogel's frusta cannot see, found before anything is drawn
drawing      The draws of one program: the triangles that each camera draws with it, for many hogels at
             once
geometry     A scene as all hogels of a plate share it: on the GPU once, sorted by the cameras that can
             see it
one_by_one   Hogels drawn one after the other by `Rasterizer`, for scenes that ask for several samples a
             pixel
parts        Parts of films that are wanted: drawn and read back alone, with the pixels of whole films
picture      The pictures of several hogels: every camera's picture and, over them, every camera's
             reflections
plain_loop   What drawing many hogels at once is measured against: one hogel after the other, all
              triangles twice
program      The programs that draw many hogels at once, made of the same shaders as those that draw one
reflection   Mirror-like surfaces of many hogels at once, in a pass of its own per camera (paper,
             section 6)
renderer     Many hogels per submission: the paper's double frustum for a whole plate, as a stream
submissions  Submissions to the device: how many hogels one draws, and the buffers it owns until it is
             read back
targets      Framebuffers with a layer for each of several hogels, and their way back to the processor
"""
