"""Views of eyes in front of the plate, true and replayed, every ray certified.

* view: the rays of an eye, the pixels of hogels in its view, and both views
* first: first surfaces along lines without a common point
"""
