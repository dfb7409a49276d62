"""Reading and writing clouds, patches, results and models."""
