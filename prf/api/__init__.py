"""What `import prf` offers, beside models and readers that stand elsewhere; the verbs are thin layers over it."""
