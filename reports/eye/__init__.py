"""What a viewer sees, as a page and as files.

files     The files of a view: a page that needs nothing else, and pictures as PNG, OpenEXR and an animation
pictures  Pictures of views: as an eye sees them, as numbers that a page can read, and as maps of what is
          lost
planned   What a viewer notices of a plan: what its requirement promises, and what a replay shows to two
          eyes
quilt     Quilts: what eyes on an arc before the plate see, as tiles of one picture for lenticular displays
replayed  What two eyes are shown of drawn hogels: changes of disparity, and wrong surfaces by depth,
          measured
sources   Where the hogels that an eye is shown come from: drawn now, a stored plate, or anybody's files
viewing   What eyes see of a scene, of its replayed truth and of a renderer's hogels, and the losses between
"""
