"""The interactive view of an arm on the page of a result: what it shows, and the library that draws it."""
