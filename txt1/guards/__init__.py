"""Guards of the safety gate: each lowers a set-point to the speed that its sensor finds safe."""
