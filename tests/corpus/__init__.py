"""Input that once broke the program, one minimal file a class, with the answer that it must get."""
