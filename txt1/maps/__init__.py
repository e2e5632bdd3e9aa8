"""Maps of floors: occupancy grids, their files, and rays cast against them."""
