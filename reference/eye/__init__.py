"""What an eye before the plate sees, truly and replayed, certified.

first  The first surface along lines that have no common point: proven, or decided in integers
view   The rays of an eye; true views and replayed views, with points and color
"""
