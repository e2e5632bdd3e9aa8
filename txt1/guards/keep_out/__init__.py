"""The guard of the areas that a map says to keep out of."""
