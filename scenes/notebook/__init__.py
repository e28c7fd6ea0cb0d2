"""What objects say of themselves, and how a notebook shows them: words, tables, pictures, labelled arrays.

labels     Images as labelled arrays of xarray, with the names, units and signs of stored plates
numbers    Numbers as people read them
pictures   Images as pictures: as a screen shows them, by height, and with wrong pixels marked
shown      Objects that say in a line what they are, and that a notebook shows with tables and pictures
"""
