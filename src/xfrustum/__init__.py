"""Reference and validation toolkit for the renderers of full-parallax spatial displays."""
