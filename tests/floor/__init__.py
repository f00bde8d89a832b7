"""What happens on shop floors and in no textbook, simulated without a line of the package."""
