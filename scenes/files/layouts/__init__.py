"""Layouts: the ways in which people store the pictures of a plate, by name.

catalogue      All layouts, and the ones that bear a name
cameras        Layouts of one picture for each direction: views, as camera arrays and benchmarks store them
detection      The layouts that a set of files looks like, each with the reasons
hogel_files    Layouts of one picture for each hogel, or for each row or column of hogels
layout         What a layout says: names of files, and the pixels of the plate that each file holds
picture_files  Pictures as arrays, read and written without a change of any bit
reading        The pixels of a plate, read from files in any layout
tiles          Layouts of one picture for the whole plate: mosaics of hogels, and quilts of views
video          Rows of hogels as videos, through PyAV
writing        The pixels of a plate, written into files in any layout
"""
