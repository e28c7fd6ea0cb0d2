"""What people see of the scout of a plate: chosen apertures with their reasons, and a map.

automatic  `--apertures auto`: the scout of a plate, and the apertures chosen from it, in words and in JSON
map        The scout as a map of the plate: nearest visible |z| and outlines over columns and rows
"""
