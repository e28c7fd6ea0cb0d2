"""Truth against brute force in integers.

comparison Comparison of a true image with the exact answer, pixel by pixel
directions Comparison of truths by direction with truths by hogels, and with integers
rational   Independent truth by brute force in integers, to check the reference
selfcheck  Comparisons of many scenes, and a closed sphere
"""
