"""Assets on disk: sealed folders, written aside and renamed, that survive a crash."""
