"""The command line that both tools share: options, settings, errors, streams, files, progress, pages."""
