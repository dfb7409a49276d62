"""What all pages of both tools share: templates filled, colours and themes, canvases that move, scripts by digest."""
