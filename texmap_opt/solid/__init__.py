"""Triangle surfaces of solids: struts and joints meshed, checked, made printable."""
