// The way back from the page of a thing, to the map as it was left: set at once, before the other scripts have come.
document.getElementById("back").setAttribute("href", `/${sessionStorage.getItem("map") ?? ""}`);
