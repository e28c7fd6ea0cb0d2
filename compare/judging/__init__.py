"""One hogel of a foreign renderer, judged.

causes         Why a renderer whose settings are known still shows another triangle here and there
judged         One hogel of a foreign renderer, judged by a question: the truth, or what its author declares
outline_shift  How far have the outlines of a picture moved? Registration step by step, where no pixel
               names a triangle
"""
