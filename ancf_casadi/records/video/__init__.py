"""Videos: decoding, marks in pictures, their tracks, and the scale of the picture."""
