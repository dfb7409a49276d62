"""What `import mapq` offers, beside models and settings that stand elsewhere; the verbs are thin layers over it."""
