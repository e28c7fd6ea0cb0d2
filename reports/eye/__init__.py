"""What a viewer sees, as a page and as files.

page         The page and the files of a view, and quilts: views from an arc as tiles of one picture
pictures     Pictures of views, as numbers that a page can read, and as maps of what is lost
plan_replay  What a viewer notices of a plan: what it promises, and what a replay shows to two eyes
view         What eyes see of a scene, of its replayed truth and of hogels, and where these hogels come from
"""
