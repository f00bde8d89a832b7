"""Independent, plain implementations that the tests compare with."""
