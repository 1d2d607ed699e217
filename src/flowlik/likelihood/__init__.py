"""Error distributions of flow: families, schedules, tables, shared errors, model files, shipped models."""
