"""What is measured of a setting, and which setting is best.

best         The recommendation: which depth buffer and near planes are best, and the sentence that says so
cause_words  The causes of wrong surfaces as sentences call them, and the one that makes most of them
measurement  What a sweep measures: one row per aperture and setting, and the pictures that belong to it
"""
