"""What a viewer sees, as a page and as files.

page         The page and the files of a view: PNG, OpenEXR and an animation
plan_replay  What a viewer notices of a plan: what it promises, and what a replay shows to two eyes
quilt        Quilts: what eyes on an arc before the plate see, as tiles of one picture
view         What eyes see of a scene, of its replayed truth and of hogels, and where these hogels come from
"""
