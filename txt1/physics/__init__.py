"""Physics of other people under the simulated vehicles: commonroad-vehicle-models and MuJoCo (extra ``physics``)."""
