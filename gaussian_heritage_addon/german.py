"""German texts of the user interface. ``scripts/extract_texts.py`` lists what is missing or not used any more."""

from __future__ import annotations

__all__ = ["TEXTS"]

TEXTS: dict[str, str] = {
    "As Stated": "Wie angegeben",
    "Collection": "Sammlung",
    "Copy as Blender's Gaussians": "Als Gaussians von Blender kopieren",
    "Display": "Anzeige",
    "Export Gaussian Splats": "Gaussian Splats exportieren",
    "Far Gaussians": "Ferne Gaussians",
    "Files": "Dateien",
    "Gaussian Objects (.ply/.glb/.spz/.usd)": "Gaussian-Objekte (.ply/.glb/.spz/.usd)",
    "Gaussian Splats, One File (.ply/.glb/.spz/.usd)": "Gaussian Splats, eine Datei (.ply/.glb/.spz/.usd)",
    "Hidden": "Ausgeblendet",
    "Its name is a guess: double-click it": "Der Name ist geraten: Doppelklick ändert ihn",
    "Lighter While Turning": "Leichter beim Drehen",
    "Photos as Gaussian Scene": "Fotos als Gaussian-Szene",
    "Record": "Herkunftsnachweis",
    "Shapes": "Formen",
    "Share": "Anteil",
    "Solo": "Nur dieses",
    "Up Axis": "Achse nach oben",
    "Video as Gaussian Scene": "Video als Gaussian-Szene",
    "World": "Welt",
    "As trained, in all viewport modes": "Wie trainiert, in allen Ansichten",
    "A dot for each Gaussian, the fastest": "Ein Punkt je Gaussian; am schnellsten",
    "Axis of the file that points up": "Achse der Datei, die nach oben zeigt",
    "How the viewports show splats. Renders always show all Gaussians": (
        "Wie die Ansichten Splats zeigen. Gerendert werden immer alle Gaussians"
    ),
    "Draw with fewer pixels while the view moves, and sharpen the picture when it rests": (
        "Mit weniger Pixeln zeichnen, solange sich die Ansicht bewegt, und das Bild schärfen, wenn sie ruht"
    ),
    "Hide this object in viewports and renders": "Dieses Objekt in Ansichten und beim Rendern ausblenden",
    "Hide all objects but the one selected in the list; again: show all but the background": (
        "Alle Objekte außer dem gewählten der Liste ausblenden; noch einmal: alle außer dem Hintergrund zeigen"
    ),
    "Each object stands where it stands in this scene": "Jedes Objekt steht dort, wo es in dieser Szene steht",
    "Y points up": "Y zeigt nach oben",
    "Y points down, as in most Gaussian scenes": "Y zeigt nach unten, wie in den meisten Gaussian-Szenen",
    "Z points up, as in Blender": "Z zeigt nach oben, wie in Blender",
    "Compressed to a sixth of the size, with some loss and without a record": (
        "Auf ein Sechstel der Größe verdichtet, mit etwas Verlust und ohne Herkunftsnachweis"
    ),
    "Skip Gaussians with invalid values instead of rejecting the file": (
        "Gaussians mit ungültigen Werten auslassen, statt die Datei abzulehnen"
    ),
    "Selected splats, including whole scenes": "Ausgewählte Splats, auch ganze Szenen",
    "Action": "Aktion",
    "Active Object": "Aktives Objekt",
    "Add": "Hinzufügen",
    "Add by Lasso": "Hinzufügen: Lasso",
    "Add by Box": "Hinzufügen: Rechteck",
    "Take by Lasso": "Wegnehmen: Lasso",
    "Take by Box": "Wegnehmen: Rechteck",
    "All": "Alle",
    "As Trained": "Wie trainiert",
    "Assign to Object": "Dem Objekt zuweisen",
    "Automatic": "Automatisch",
    "Background": "Hintergrund",
    "Blending": "Überblendung",
    "Box": "Rechteck",
    "By Hand": "Von Hand",
    "Cameras": "Kameras",
    "Cancel": "Abbrechen",
    "Catalogue Number": "Inventarnummer",
    "Check": "Prüfen",
    "Check Models": "Modelle prüfen",
    "Clear Measurement": "Messung löschen",
    "Click Object": "Objekt anklicken",
    "Click in View": "In der Ansicht klicken",
    "Clicks": "Klicks",
    "Close List": "Liste schließen",
    "Closest matches:": "Ähnlichste Funde:",
    "Confidence": "Sicherheit",
    "Continue": "Fortsetzen",
    "Correct": "Korrigieren",
    "Correct by Clicks": "Durch Klicks korrigieren",
    "Delete": "Löschen",
    "Delete Object": "Objekt löschen",
    "Deleted Objects": "Gelöschte Objekte",
    "Depth": "Tiefe",
    "Distance": "Abstand",
    "Done": "Fertig",
    "Edit in Region": "Im Bereich bearbeiten",
    "Edited by Hand": "Von Hand bearbeitet",
    "Error against Run Time": "Fehler über der Laufzeit",
    "Existing Python": "Vorhandenes Python",
    "Export Gaussian Objects": "Gauß-Objekte exportieren",
    "Export Objects": "Objekte exportieren",
    "Fetch": "Laden",
    "Fetch ...": "Laden ...",
    "Fetch Model": "Modell laden",
    "Find All": "Alle finden",
    "Floaters": "Schwebende Reste",
    "Folder": "Ordner",
    "Format": "Format",
    "From Plane": "Aus Ebene",
    "Gaussian Heritage": "Gaussian Heritage",
    "Gaussian Heritage Project": "Gaussian-Heritage-Projekt",
    "Gaussian Scene": "Gauß-Szene",
    "Gaussian Scene (.ply)": "Gauß-Szene (.ply)",
    "Ground": "Boden",
    "Ground from Plane": "Boden aus Ebene",
    "Import Gaussian Scene": "Gauß-Szene importieren",
    "Import Photo Folder": "Fotoordner importieren",
    "Isolate": "Freistellen",
    "Isolate Candidate": "Kandidaten freistellen",
    "Isolate in View": "Freistellen",
    "Keep": "Behalten",
    "Kind": "Art",
    "Known Distance": "Bekannter Abstand",
    "Lasso": "Lasso",
    "Leave": "Liegen lassen",
    "Leave Result": "Ergebnis liegen lassen",
    "Level": "Stufe",
    "Level in the Project": "Stufe im Projekt",
    "Levels": "Stufen",
    "Linear": "Linear",
    "List": "Liste",
    "Longest Side": "Längste Seite",
    "Look Through Photo": "Durch das Foto blicken",
    "Measure": "Messen",
    "Merge Objects": "Objekte vereinigen",
    "Merge Selected": "Auswahl vereinigen",
    "Metres": "Meter",
    "Model": "Modell",
    "Models": "Modelle",
    "Name": "Name",
    "Neighbours": "Nachbarn",
    "None": "Keine",
    "North": "Norden",
    "Not found": "Nicht gefunden",
    "Not found, see Objects": "Nicht gefunden, siehe Objekte",
    "Notes": "Bemerkungen",
    "Number": "Nummer",
    "Object": "Objekt",
    "Object Id": "Kennung des Objekts",
    "Objects": "Objekte",
    "Offline Bundle": "Offline-Paket",
    "Offline Folder": "Offline-Ordner",
    "Opacity": "Deckkraft",
    "Open Project": "Projekt öffnen",
    "Open Report": "Bericht öffnen",
    "Open Result": "Ergebnis öffnen",
    "Origin": "Ursprung",
    "PSNR in dB, higher is better, against seconds": "PSNR in dB, höher ist besser, über Sekunden",
    "Part to Whole": "Teil bis Ganzes",
    "Path": "Pfad",
    "Photo": "Foto",
    "Photo Folder as Gaussian Scene": "Fotoordner als Gauß-Szene",
    "Photos": "Fotos",
    "Pick": "Anklicken",
    "Points": "Punkte",
    "Preset": "Voreinstellung",
    "Processor": "Prozessor",
    "Progress": "Fortschritt",
    "Project": "Projekt",
    "Prompt": "Suchwort",
    "Python for Set-Up": "Python für die Einrichtung",
    "Ready": "Bereit",
    "Refine Object": "Objekt verfeinern",
    "Remove": "Entfernen",
    "Remove Default Cube and Light": "Würfel und Licht entfernen",
    "Remove Engine": "Engine entfernen",
    "Remove Floaters": "Reste entfernen",
    "Remove from Queue": "Aus der Warteschlange nehmen",
    "Replace": "Ersetzen",
    "Replace Files": "Dateien ersetzen",
    "Report": "Bericht",
    "Rights": "Rechte",
    "Role": "Rolle",
    "Ruler": "Lineal",
    "Scene": "Szene",
    "Select": "Auswählen",
    "Select in View": "Auswählen",
    "Selected": "Ausgewählte",
    "Set Up": "Einrichten",
    "Set Up Engine": "Engine einrichten",
    "Set up Cycles": "Cycles einrichten",
    "Shape": "Form",
    "Show": "Zeigen",
    "Show Floaters": "Reste zeigen",
    "Show Folder": "Ordner zeigen",
    "Skip Broken": "Defekte überspringen",
    "Split Object": "Objekt teilen",
    "Split Off as New Object": "Als neues Objekt abtrennen",
    "Started before Blender was closed": "Vor dem Schließen von Blender gestartet",
    "Step": "Schritt",
    "Stopped": "Angehalten",
    "Store Edits": "Änderungen speichern",
    "Surface": "Oberfläche",
    "Take": "Wegnehmen",
    "Take from Object": "Vom Objekt wegnehmen",
    "Threshold": "Schwellwert",
    "Through": "Hindurch",
    "Title": "Titel",
    "Verify": "Überprüfen",
    "Video": "Video",
    "Wanted": "Erwünscht",
    "vase; teapot": "Vase; Teekanne",
    "A Gaussian with a lower opacity is faint": "Eine Gauß-Glocke mit geringerer Deckkraft gilt als blass",
    "A Gaussian with fewer others near it is isolated; most have about 20": (
        "Eine Gauß-Glocke mit weniger anderen in ihrer Nähe gilt als einzeln; die meisten haben etwa 20"
    ),
    "A distance that you have measured on the real object, in metres; then pick its two ends": (
        "Ein Abstand, den Sie am echten Objekt gemessen haben, in Metern; klicken Sie dann seine beiden Enden an"
    ),
    "A video to take the photos from, instead of a folder": "Ein Video statt eines Ordners, aus dem die Fotos kommen",
    "A whole scene": "Eine ganze Szene",
    "Add a camera for each photo": "Für jedes Foto eine Kamera hinzufügen",
    "Add a project folder to this file: its scene, cameras and objects. Each project has a scene of its own": (
        "Ein Projekt in diese Datei holen: Szene, Kameras und Objekte. Jedes Projekt hat eine eigene Szene"
    ),
    "Add what the region shows of the scene to the object": (
        "Was der Bereich von der Szene zeigt, wird Teil des Objekts"
    ),
    "All isolated objects": "Alle freigestellten Objekte",
    "Also all that is behind it": "Auch alles, was dahinter liegt",
    "An isolated object": "Ein freigestelltes Objekt",
    "Changed in this file, and not yet stored in the project": (
        "In dieser Datei geändert und noch nicht im Projekt gespeichert"
    ),
    "Click an object on its photos. Shift-click what is not part of it, and press Enter to finish": (
        "Ein Objekt auf seinen Fotos anklicken. Umschalt-Klick auf das, was nicht dazugehört; Eingabe beendet"
    ),
    "Click in the 3D view. Select: the isolated object that you see there. Isolate: make an object of what you see": (
        "In die 3D-Ansicht klicken. Auswählen: das freigestellte Objekt, das dort zu sehen ist. Freistellen: aus dem, "
        "was dort zu sehen ist, ein Objekt machen"
    ),
    "Click on the splats: the ends of a known distance, points of the ground, north or the origin; or use a ruler": (
        "Auf die Szene klicken: die Enden eines bekannten Abstands, Punkte des Bodens, Norden oder Ursprung; oder mit "
        "dem Lineal messen"
    ),
    "Credit line, licence or rights statement": "Bildnachweis, Lizenz oder Rechtehinweis",
    "Delete the object selected in the list. Ctrl+Z brings it back; stored, it goes to the trash of the project": (
        "Das in der Liste gewählte Objekt löschen. Strg+Z holt es zurück; gespeichert kommt es in den Papierkorb des "
        "Projekts"
    ),
    "Drag around what you mean": "Um das ziehen, was gemeint ist",
    "Drag around what you mean. Add: it becomes part of the object selected in the list. Take: it leaves the object": (
        "Um das ziehen, was gemeint ist. Hinzufügen: es wird Teil des gewählten Objekts. Wegnehmen: es gehört nicht "
        "mehr dazu"
    ),
    "Drag from one corner of a box to the other": "Von einer Ecke des Rechtecks zur anderen ziehen",
    "Export each object to its own file, with its placement, scale and threshold in this scene": (
        "Jedes Objekt in eine eigene Datei schreiben, wie es in dieser Szene steht, mit Größe und Schwellwert"
    ),
    "Folder for the exported files": "Ordner für die exportierten Dateien",
    "Folder with the photos": "Ordner mit den Fotos",
    "From the smallest part (a lid) to the whole it belongs to (the vase)": (
        "Vom kleinsten Teil (dem Deckel) bis zum Ganzen (der Vase)"
    ),
    "How far behind the visible surface the region reaches": (
        "Wie weit der Bereich hinter die sichtbare Oberfläche reicht"
    ),
    "How the region is drawn": "Wie der Bereich gezeichnet wird",
    "Import a Gaussian scene from a PLY file, as written by any Gaussian splatting program": (
        "Eine Gauß-Szene aus einer PLY-Datei importieren, wie sie Gaussian-Splatting-Programme schreiben"
    ),
    "Install what reconstructs scenes: Python packages and model files. Continues a set-up that was stopped": (
        "Installieren, was Szenen rekonstruiert: Python-Pakete und Modelldateien. Setzt Angehaltenes fort"
    ),
    "Isolate every object of the scene, with suggested names, and the background. Existing objects are kept": (
        "Jedes Objekt der Szene mit einem vorgeschlagenen Namen freistellen, und den Hintergrund. Vorhandene bleiben"
    ),
    'Isolate the objects named in the prompt (separate several with ";"), or the object clicked on photos': (
        "Die genannten Objekte freistellen (mehrere durch „;“ trennen) oder das auf Fotos angeklickte"
    ),
    "Isolate the thing that is seen at the click as a new object": (
        "Was am Klick zu sehen ist, als neues Objekt freistellen"
    ),
    "Isolate what belongs to no object as the background. An earlier background goes to the project's trash": (
        "Was zu keinem Objekt gehört, als Hintergrund freistellen. Ein früherer kommt in den Papierkorb des Projekts"
    ),
    "Make a new object of the Gaussians selected in Edit Mode, and take them from the object that they are part of": (
        "Aus der Auswahl im Bearbeitungsmodus ein neues Objekt machen und sie vom bisherigen wegnehmen"
    ),
    "Make the Gaussians selected in Edit Mode part of the object selected in the list. The scene keeps its own copy": (
        "Die Auswahl im Bearbeitungsmodus wird Teil des gewählten Objekts. Die Szene behält ihre Kopie"
    ),
    "Make the camera of a photo the active camera, and give renders the size of the photo": (
        "Durch die Kamera eines Fotos blicken; Bilder bekommen die Größe des Fotos"
    ),
    "Make the plane of the active object the ground: lay a plane on the floor by hand, then press this": (
        "Die Ebene des aktiven Objekts wird der Boden: legen Sie eine Fläche auf den Fußboden, dann drücken Sie hier"
    ),
    "Match the colours of the photos; uses the view transform Raw": "Farben wie auf den Fotos; nutzt „Raw“",
    "Merge all selected isolated objects into the one that is selected in the list": (
        "Alle ausgewählten freigestellten Objekte mit dem in der Liste gewählten vereinigen"
    ),
    'Objects to isolate, in words; separate several with ";" (vase;teapot)': (
        "Freizustellende Objekte in Worten, auf Englisch; mehrere durch „;“ trennen (vase;teapot)"
    ),
    "Only the surface that is seen": "Nur die Oberfläche, die zu sehen ist",
    "Opacity of the photo over the splats": "Deckkraft des Fotos über der Szene",
    "Open the report of the reconstruction in the web browser: errors, run times, and what was left out": (
        "Den Bericht der Rekonstruktion im Browser öffnen: Fehler, Laufzeiten und was weggelassen wurde"
    ),
    "Project folder of this scene": "Projektordner dieser Szene",
    "Remove a known distance, or all that was measured. The scene gets its former place and size": (
        "Einen bekannten Abstand oder alles Gemessene entfernen. Die Szene bekommt ihre frühere Lage und Größe"
    ),
    "Replace existing files": "Vorhandene Dateien ersetzen",
    "Select the isolated object that is seen at the click": "Das freigestellte Objekt am Klick auswählen",
    "Show the folder of the project in the system's file browser": "Den Ordner des Projekts zeigen",
    "Show the isolated objects": "Die freigestellten Objekte zeigen",
    "Show the whole scene": "Die ganze Szene zeigen",
    "Show what floats around the object, isolated or faint Gaussians, as a selection in Edit Mode; or remove it": (
        "Was um das Objekt schwebt, einzelne oder blasse Gauß-Glocken, im Bearbeitungsmodus auswählen; oder entfernen"
    ),
    "Smallest membership of a Gaussian in the object; higher values make the object tighter": (
        "Kleinste Zugehörigkeit einer Gauß-Glocke zum Objekt; höhere Werte machen es enger"
    ),
    "Start the stopped job again. It continues with the work that is finished": (
        "Die angehaltene Arbeit wieder starten. Fertiges bleibt"
    ),
    "Stop the running job. Start the same import again to resume it": (
        "Die laufende Arbeit anhalten. Derselbe Import setzt sie fort"
    ),
    "Store what was edited by hand in the project. What it replaces or deletes goes to the project's trash": (
        "Von Hand Geändertes im Projekt speichern. Ersetztes und Gelöschtes kommt in den Papierkorb des Projekts"
    ),
    "Take the Gaussians selected in Edit Mode away from their object. They stay in the scene": (
        "Die Auswahl im Bearbeitungsmodus von ihrem Objekt wegnehmen. In der Szene bleibt sie"
    ),
    "Take them from the object instead of showing them": "Sie vom Objekt wegnehmen, statt sie zu zeigen",
    "Take what the region shows of the object away from it": "Was der Bereich vom Objekt zeigt, wird weggenommen",
    "The known distance in metres": "Der bekannte Abstand in Metern",
    "The object in words, for example vase": "Das Objekt in Worten, auf Englisch, zum Beispiel vase",
    "The point that becomes the origin": "Der Punkt, der zum Ursprung wird",
    "The surface when something is added, everything when something is taken": (
        "Die Oberfläche beim Hinzufügen, alles beim Wegnehmen"
    ),
    "The whole scene": "Die ganze Szene",
    "Three or more points of the ground, which becomes level at height 0": (
        "Drei oder mehr Punkte des Bodens, der waagrecht auf Höhe 0 kommt"
    ),
    "Turn a folder of photos, or a video, into a Gaussian scene. Resumes an earlier import of the same photos": (
        "Aus einem Ordner mit Fotos oder einem Video eine Gauß-Szene machen. Setzt einen früheren Import fort"
    ),
    "Two points whose distance is shown": "Zwei Punkte, deren Abstand angezeigt wird",
    "Two points whose distance you know; several distances are averaged": (
        "Zwei Punkte mit bekanntem Abstand; mehrere Abstände werden gemittelt"
    ),
    "Two points, the second to the north of the first; north becomes the Y axis": (
        "Zwei Punkte, der zweite nördlich des ersten; Norden wird die Y-Achse"
    ),
    "What a click does": "Was ein Klick bewirkt",
    "What is done with the Gaussians in the region": "Was mit den Gauß-Glocken im Bereich geschieht",
    "What the points mean": "Was die Punkte bedeuten",
}
"""German text by English text, as Blender shows them."""
