"""Truth against brute force in integers.

rational   Independent truth by brute force in integers, to check the reference
selfcheck  Comparison of the reference with it, pixel by pixel, and a closed sphere
"""
