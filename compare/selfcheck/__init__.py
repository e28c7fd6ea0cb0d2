"""The truth against brute force in integers.

rational       The truth once more, by brute force in integers, to check the reference with
selfcheck      Is the truth true? The reference against integer brute force, pixel by pixel, and a
sphere
"""
