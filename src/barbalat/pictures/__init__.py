"""Pictures as data, and how they are drawn: panels over time, responses over frequency. It knows no run and no certificate."""
