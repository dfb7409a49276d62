"""What `import prf` offers, beside models and readers from elsewhere; the verbs are thin layers over it."""
