"""How well a car drives that was taught by driving: on real pictures, beside other policies, with take-overs."""
