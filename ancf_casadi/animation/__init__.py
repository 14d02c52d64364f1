"""Moving pictures of beams: motions and mode shapes, as GIF, MP4, and HTML pages with a player."""
