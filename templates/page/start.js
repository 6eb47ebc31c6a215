// Which page this is.

if (data.kind === 'sweep') sweepPage();
else designPage();
