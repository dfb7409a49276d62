"""From a cloud or its patches to a result: labels, probabilities, reasons in words, regions, and maps compared."""
