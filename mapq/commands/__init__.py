"""One verb a file: parse, one call of the library, render."""
