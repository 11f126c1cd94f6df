(() => {
"use strict";
{% include "drawing.js" %}
{% include "explore.js" %}
{% include "follow.js" %}
})();
