"""Others' physics for the simulated vehicles: commonroad-vehicle-models and MuJoCo, found by entry points."""
