"""From shapes, materials and daylight to pictures with exact depth."""
