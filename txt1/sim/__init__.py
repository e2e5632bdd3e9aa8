"""The simulated robot: vehicle, batteries, encoders and room. No clock and no asyncio: the caller gives the time."""
