"""What the words of a command line ask for: options, their quantities, the robot and the problem that they describe."""
