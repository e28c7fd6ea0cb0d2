"""A model of somebody else's renderer: conventions, geometry, what it draws.

changed_scene The scene with other axes, or with objects left out or elsewhere conventions   The
conventions that a renderer's author may declare, and the eight symmetries of a grid drawn_model   A
model of how somebody drew a plate: conventions, geometry, and which camera wins where pictures
Images that a guess about a renderer makes of a scene, and the surface points that they show
"""
