"""What a viewer sees: the display's loss, the renderer's, and the scene that a near offset replays.

moved  The scene that a viewer sees where cameras step back by a near offset: a theorem and its closed form
"""
