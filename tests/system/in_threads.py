"""An executor by module:factory."""

from concurrent.futures import ThreadPoolExecutor


def executor():
    return ThreadPoolExecutor(1)
