"""The exosystem and the observer: observability, detectability, A - WC Hurwitz."""
