"""What a certificate or a problem becomes outside this package: today a proof that Coq checks."""
