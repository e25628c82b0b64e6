"""German tooltips of the user interface; see `german`, which has the labels."""

from __future__ import annotations

__all__ = ["TEXTS"]

TEXTS: dict[str, str] = {
    "Do not offer to continue this job any more. Its finished work stays in the project": (
        "Diese Arbeit nicht mehr zum Fortsetzen anbieten. Was fertig ist, bleibt im Projekt"
    ),
    "Keep only those selected that were selected before": "Nur ausgewählt lassen, was vorher schon ausgewählt war",
    "Keep what is selected, and select this as well": "Die Auswahl behalten und dies dazu auswählen",
    "Select all objects, and splat objects, in a box or a lasso": (
        "Alle Objekte und Splat-Objekte in einem Rechteck oder Lasso auswählen"
    ),
    "Select the splat object that is clicked": "Das angeklickte Splat-Objekt auswählen",
    "Select them alone": "Nur sie auswählen",
    "Select them as well": "Sie dazu auswählen",
    "Select this as well, or take it out where it is active already": (
        "Dies dazu auswählen, oder abwählen, wo es schon aktiv ist"
    ),
    "Select those that were not selected, and the other way round": (
        "Auswählen, was nicht ausgewählt war, und umgekehrt"
    ),
    "Take them out of what is selected": "Sie aus der Auswahl nehmen",
    "Take this out of what is selected": "Dies aus der Auswahl nehmen",
    "What is done with the objects in the region": "Was mit den Objekten im Bereich geschieht",
    "0 is the smallest part": "0 ist der kleinste Teil",
    "0 is the smallest part; -1: do not change the level": "0 ist der kleinste Teil; -1: die Stufe nicht ändern",
    "A distance that you have measured on the real object, in metres; then pick its two ends": (
        "Ein Abstand, den Sie am echten Objekt gemessen haben, in Metern; klicken Sie dann seine beiden Enden an"
    ),
    "A distance that you have measured on the real object, such as 30 cm; then pick its two ends": (
        "Ein Abstand, den Sie am echten Objekt gemessen haben, etwa 30 cm; klicken Sie dann seine beiden Enden an"
    ),
    "A dot for each Gaussian, the fastest": "Ein Punkt je Gauß-Glocke; am schnellsten",
    "A Gaussian with a lower opacity is faint": "Eine Gauß-Glocke mit geringerer Deckkraft gilt als blass",
    "A Gaussian with fewer others near it is isolated; most have about 20": (
        "Eine Gauß-Glocke mit weniger anderen in ihrer Nähe gilt als einzeln; die meisten haben etwa 20"
    ),
    "A video to take the photos from, instead of a folder": "Ein Video statt eines Ordners, aus dem die Fotos kommen",
    "Choose where the missing project of this scene is now. The scene and its objects stay as they are": (
        "Wählen, wo das fehlende Projekt dieser Szene jetzt ist. Szene und Objekte bleiben, wie sie sind"
    ),
    "A whole scene": "Eine ganze Szene",
    "Add a camera for each photo": "Für jedes Foto eine Kamera hinzufügen",
    "Add a project folder to this file: its scene, cameras and objects. Each project has a scene of its own": (
        "Ein Projekt in diese Datei holen: Szene, Kameras und Objekte. Jedes Projekt hat eine eigene Szene"
    ),
    "Add what the region shows of the scene to the object": (
        "Was der Bereich von der Szene zeigt, wird Teil des Objekts"
    ),
    "All isolated objects that are shown, without the background": (
        "Alle freigestellten Objekte, die angezeigt werden, ohne den Hintergrund"
    ),
    "Also all that is behind it": "Auch alles, was dahinter liegt",
    "An isolated object": "Ein freigestelltes Objekt",
    "As trained, in all viewport modes": "Wie trainiert, in allen Ansichten",
    "Axis of the file that points up; GLB defines it": ("Achse der Datei, die nach oben zeigt; GLB legt sie fest"),
    "Recommended: binary glTF with KHR_gaussian_splatting and the record, upright in every program": (
        "Empfohlen: binäres glTF mit KHR_gaussian_splatting und den Objektdaten, steht in jedem Programm aufrecht"
    ),
    "Format of the files": "Format der Dateien",
    "With All: include the objects whose eye is closed": "Bei „Alle“: auch die Objekte, deren Auge geschlossen ist",
    "With All: include the background, which surrounds the objects": (
        "Bei „Alle“: auch den Hintergrund, der die Objekte umgibt"
    ),
    "Blend light, like other objects in Blender; uses the view transform Standard": (
        "Licht mischen wie andere Objekte in Blender; nutzt die Ansichtstransformation „Standard“"
    ),
    "Blender's own objects, for previews with EEVEE and Cycles; slow": (
        "Objekte von Blender selbst, für Vorschauen mit EEVEE und Cycles; langsam"
    ),
    "Build of PyTorch that is installed": "Fassung von PyTorch, die installiert wird",
    "Changed in this file, and not yet stored in the project": (
        "In dieser Datei geändert und noch nicht im Projekt gespeichert"
    ),
    "Check only required and available files, and report every problem": (
        "Nur benötigte und vorhandene Dateien prüfen und jeden Fehler melden"
    ),
    "Check that the engine's Python has everything the engine needs": (
        "Prüfen, ob das Python der Engine alles hat, was die Engine braucht"
    ),
    "Check which model files are available and whether they are unchanged": (
        "Prüfen, welche Modelldateien vorhanden und ob sie unverändert sind"
    ),
    "Click an object on its photos. Shift-click what is not part of it, and press Enter to finish": (
        "Ein Objekt auf seinen Fotos anklicken. Umschalt-Klick auf das, was nicht dazugehört; Eingabe beendet"
    ),
    "Click in the 3D view. Select: the isolated object that you see there. Isolate: make an object of what you see": (
        "In die 3D-Ansicht klicken. Auswählen: das freigestellte Objekt, das dort zu sehen ist. Freistellen: "
        "aus dem, was dort zu sehen ist, ein Objekt machen"
    ),
    "Click on the splats: the ends of a known distance, points of the ground, north or the origin; or use a ruler": (
        "Auf die Szene klicken: die Enden eines bekannten Abstands, Punkte des Bodens, Norden oder Ursprung; "
        "oder mit dem Lineal messen"
    ),
    "Clicks on one object, instead of a prompt": "Klicks auf ein Objekt, statt eines Suchworts",
    "Close the list of prompts that were not found": (
        "Die Liste der Suchwörter schließen, zu denen nichts gefunden wurde"
    ),
    "Compressed to a sixth of the size, with some loss and without a record": (
        "Auf ein Sechstel der Größe verdichtet, mit etwas Verlust und ohne Herkunftsnachweis"
    ),
    "Confidence that this is the requested object, 0 to 1": (
        "Sicherheit, dass dies das gesuchte Objekt ist, von 0 bis 1"
    ),
    "Copy the shown scene or objects as Gaussians of Blender's own type, for EEVEE and Cycles": (
        "Die gezeigte Szene oder die gezeigten Objekte als Gauß-Glocken in Blenders eigener Art kopieren, für"
        " EEVEE und Cycles"
    ),
    "Correct an object by clicks, or store its level in the project. Name, placement and record are kept": (
        "Ein Objekt durch Klicks korrigieren oder seine Stufe im Projekt speichern. Name, Lage und "
        "Herkunftsnachweis bleiben"
    ),
    "Correct the selected object instead of isolating a new one": (
        "Das gewählte Objekt korrigieren, statt ein neues freizustellen"
    ),
    "Credit line, licence or rights statement": "Bildnachweis, Lizenz oder Rechtehinweis",
    "Delete the cube and the light that every new Blender file has; only as long as nobody changed them": (
        "Würfel und Licht löschen, die jede neue Blender-Datei enthält; nur solange niemand sie verändert hat"
    ),
    "Delete the engine's packages. Projects and model files are kept": (
        "Die Pakete der Engine löschen. Projekte und Modelldateien bleiben"
    ),
    "Delete the object selected in the list. Ctrl+Z brings it back; stored, it goes to the trash of the project": (
        "Das in der Liste gewählte Objekt löschen. Strg+Z holt es zurück; gespeichert kommt es in den "
        "Papierkorb des Projekts"
    ),
    "Do not start this job": "Diese Arbeit nicht beginnen",
    "Drag around what you mean": "Um das ziehen, was gemeint ist",
    "Drag around what you mean. Add: it becomes part of the object selected in the list. Take: it leaves the object": (
        "Um das ziehen, was gemeint ist. Hinzufügen: es wird Teil des gewählten Objekts. Wegnehmen: es gehört"
        " nicht mehr dazu"
    ),
    "Drag from one corner of a box to the other": "Von einer Ecke des Rechtecks zur anderen ziehen",
    "Draw with fewer pixels while the view moves, and sharpen the picture when it rests": (
        "Mit weniger Pixeln zeichnen, solange sich die Ansicht bewegt, und das Bild schärfen, wenn sie ruht"
    ),
    "Each object stands where it stands in this scene": "Jedes Objekt steht dort, wo es in dieser Szene steht",
    "Export each object to its own file, with its placement, scale and threshold in this scene": (
        "Jedes Objekt in eine eigene Datei schreiben, wie es in dieser Szene steht, mit Größe und Schwellwert"
    ),
    "Export the selected splats, or those of a collection, together to one file": (
        "Die ausgewählten Splats, oder die einer Sammlung, zusammen in eine Datei schreiben"
    ),
    "Fetch the files of a model. Its licence is shown first. Resumes a download that was stopped": (
        "Die Dateien eines Modells laden. Zuerst wird seine Lizenz gezeigt. Setzt einen angehaltenen Download fort"
    ),
    "File that the engine is set up from, without a network; empty: download everything": (
        "Datei, aus der die Engine ohne Netz eingerichtet wird; leer: alles herunterladen"
    ),
    "Folder for the exported files": "Ordner für die exportierten Dateien",
    "Folder that the scene is stored in; empty: create it next to the photo folder": (
        "Ordner, in dem die Szene gespeichert wird; leer: neben dem Fotoordner anlegen"
    ),
    "Folder with a mask for each photo, named like it; what is black in them is left out": (
        "Ordner mit einer Maske je Foto, benannt wie das Foto; was darin schwarz ist, bleibt außer Acht"
    ),
    "Folder with model files that you already have; empty: download them": (
        "Ordner mit Modelldateien, die Sie schon haben; leer: sie herunterladen"
    ),
    "Folder with the photos": "Ordner mit den Fotos",
    "For NVIDIA graphics cards where this computer has their driver": (
        "Für Grafikkarten von NVIDIA, wenn dieser Computer ihren Treiber hat"
    ),
    "For NVIDIA graphics cards; 5 GB more": "Für Grafikkarten von NVIDIA; 5 GB mehr",
    "For the web, up to a twentieth of the size, with some loss, -Y up as its viewers expect": (
        "Für das Web, bis auf ein Zwanzigstel der Größe, mit etwas Verlust, -Y oben, wie Betrachter es erwarten"
    ),
    "For scripts: look through this photo instead of the 3D view": (
        "Für Skripte: durch dieses Foto blicken, statt in die 3D-Ansicht"
    ),
    'For scripts: names of the objects to merge in, separated by ";"; empty: the selected ones': (
        "Für Skripte: Namen der Objekte, die hinzukommen, durch „;“ getrennt; leer: die ausgewählten"
    ),
    "For scripts: pixels from the left edge of the photo": "Für Skripte: Pixel vom linken Rand des Fotos",
    "For scripts: pixels from the top edge of the photo": "Für Skripte: Pixel vom oberen Rand des Fotos",
    "For scripts: pixels of photos instead of clicks in the view": (
        "Für Skripte: Pixel von Fotos statt Klicks in der Ansicht"
    ),
    "For scripts: the corners of the region in pixels of one photo; two corners are those of a box": (
        "Für Skripte: die Ecken des Bereichs in Pixeln eines Fotos; zwei Ecken sind die eines Rechtecks"
    ),
    "From the smallest part (a lid) to the whole it belongs to (the vase)": (
        "Vom kleinsten Teil (dem Deckel) bis zum Ganzen (der Vase)"
    ),
    "green, yellow or red; empty if unknown": "grün, gelb oder rot; leer, wenn unbekannt",
    "Hide all objects but the one selected in the list; again: show all but the background": (
        "Alle Objekte außer dem gewählten der Liste ausblenden; noch einmal: alle außer dem Hintergrund zeigen"
    ),
    "Hide this object in viewports and renders": "Dieses Objekt in Ansichten und beim Rendern ausblenden",
    "How far behind the visible surface the region reaches": (
        "Wie weit der Bereich hinter die sichtbare Oberfläche reicht"
    ),
    "How much work is done, and how good the scene becomes": "Wie viel gerechnet wird, und wie gut die Szene wird",
    "How the object was found: text, click, all or background": (
        "Wie das Objekt gefunden wurde: Text (text), Klick (click), alle (all) oder Hintergrund (background)"
    ),
    "How the region is drawn": "Wie der Bereich gezeichnet wird",
    "How the viewports show splats. Renders always show all Gaussians": (
        "Wie die Ansichten Splats zeigen. Gerendert werden immer alle Gauß-Glocken"
    ),
    "Id of the object in the project": "Kennung des Objekts im Projekt",
    "Id of the object in the project; empty: the object selected in the list": (
        "Kennung des Objekts im Projekt; leer: das in der Liste gewählte Objekt"
    ),
    "Ids of objects that were deleted in this file, one a line, until stored": (
        "Kennungen der in dieser Datei gelöschten Objekte, eine je Zeile, bis gespeichert wird"
    ),
    "Import a Gaussian scene from a PLY, SPZ, SOG, SPLAT, KSPLAT or GLB file, as written by any splatting program": (
        "Eine Gauß-Szene aus PLY, SPZ, SOG, SPLAT, KSPLAT oder GLB importieren, wie sie Splatting-Programme schreiben"
    ),
    (
        "Include the Gaussians of a whole scene that lie far outside of what the photos show, which make "
        "other programs show the scene as a dot"
    ): (
        "Auch die Gauß-Glocken einer ganzen Szene schreiben, die weit außerhalb des Fotografierten liegen; "
        "andere Programme zeigen die Szene dann als Punkt"
    ),
    "Install what reconstructs scenes: Python packages and model files. Continues a set-up that was stopped": (
        "Installieren, was Szenen rekonstruiert: Python-Pakete und Modelldateien. Setzt Angehaltenes fort"
    ),
    "Isolate every object of the scene, with suggested names, and the background. Existing objects are kept": (
        "Jedes Objekt der Szene mit einem vorgeschlagenen Namen freistellen, und den Hintergrund. Vorhandene bleiben"
    ),
    "Isolate the objects named in the prompt (separate several with commas), or the object clicked on photos": (
        "Die genannten Objekte freistellen (mehrere durch Kommas trennen) oder das auf Fotos angeklickte"
    ),
    "Isolate the thing that is seen at the click as a new object": (
        "Was am Klick zu sehen ist, als neues Objekt freistellen"
    ),
    "Isolate this candidate and name it after the prompt": (
        "Diesen Kandidaten freistellen und nach dem Suchwort benennen"
    ),
    "Isolate what belongs to no object as the background. An earlier background goes to the project's trash": (
        "Was zu keinem Objekt gehört, als Hintergrund freistellen. Ein früherer kommt in den Papierkorb des Projekts"
    ),
    "Leave the background out, for an object on a turntable before a background that stands still": (
        "Den Hintergrund weglassen: für ein Objekt auf einem Drehteller vor einem Hintergrund, der stillsteht"
    ),
    "Known cameras of COLMAP, nerfstudio, Metashape or RealityCapture; empty: estimate the cameras": (
        "Bekannte Kameras von COLMAP, nerfstudio, Metashape oder RealityCapture; leer: die Kameras schätzen"
    ),
    "Leave the result in its project. Open Project shows it later": (
        "Das Ergebnis in seinem Projekt liegen lassen. „Projekt öffnen“ zeigt es später"
    ),
    "Longest side of a render in pixels; 0: that of the photo": (
        "Längste Seite eines gerenderten Bildes in Pixeln; 0: die des Fotos"
    ),
    "Make a new object of the Gaussians selected in Edit Mode, and take them from the object that they are part of": (
        "Aus der Auswahl im Bearbeitungsmodus ein neues Objekt machen und sie vom bisherigen wegnehmen"
    ),
    "Make the camera of a photo the active camera, and give renders the size of the photo": (
        "Durch die Kamera eines Fotos blicken; Bilder bekommen die Größe des Fotos"
    ),
    "Make the Gaussians selected in Edit Mode part of the object selected in the list. The scene keeps its own copy": (
        "Die Auswahl im Bearbeitungsmodus wird Teil des gewählten Objekts. Die Szene behält ihre Kopie"
    ),
    "Make the plane of the active object the ground: lay a plane on the floor by hand, then press this": (
        "Die Ebene des aktiven Objekts wird der Boden: legen Sie eine Fläche auf den Fußboden, dann drücken Sie hier"
    ),
    "Match the colours of the photos; uses the view transform Raw": "Farben wie auf den Fotos; nutzt „Raw“",
    "Merge all selected isolated objects into the one that is selected in the list": (
        "Alle ausgewählten freigestellten Objekte mit dem in der Liste gewählten vereinigen"
    ),
    "Model that outlines objects in the photos; all except the first must be fetched before use": (
        "Modell, das die Objekte in den Fotos umreißt; alle außer dem ersten müssen vorher geladen werden"
    ),
    "Name of an isolated object; empty: object": "Name eines freigestellten Objekts; leer: object",
    "Name of the clicked photo, instead of a prompt": "Name des angeklickten Fotos, statt eines Suchworts",
    "Name of the new object; empty: that of the old": "Name des neuen Objekts; leer: der des alten",
    "Name of the object; empty: the prompt": "Name des Objekts; leer: das Suchwort",
    "Name of the photo; empty: the current photo, or else the first": (
        "Name des Fotos; leer: das jetzige Foto, sonst das erste"
    ),
    "Number of photos to move on, by name": "Um wie viele Fotos es weitergeht, nach Namen geordnet",
    "Number of the candidate": "Nummer des Kandidaten",
    "Number of the distance to remove; 0: everything": "Nummer des Abstands, der entfernt wird; 0: alles",
    "Objects to isolate, in English words; separate several with commas (vase, teapot)": (
        "Freizustellende Objekte in Worten, auf Englisch; mehrere durch Kommas trennen (vase, teapot)"
    ),
    "Off: this pixel is not part of the object": "Aus: dieses Pixel gehört nicht zum Objekt",
    "Only the surface that is seen": "Nur die Oberfläche, die zu sehen ist",
    "Opacity of the photo over the splats": "Deckkraft des Fotos über der Szene",
    "Open the report of the reconstruction in the web browser: errors, run times, and what was left out": (
        "Den Bericht der Rekonstruktion im Browser öffnen: Fehler, Laufzeiten und was weggelassen wurde"
    ),
    "Open the result in the scene that shows its project, or in a new one. Other projects are not changed": (
        "Das Ergebnis in der Szene öffnen, die sein Projekt zeigt, oder in einer neuen. Andere Projekte "
        "bleiben unverändert"
    ),
    "OpenUSD 26.03 or newer, ParticleField3DGaussianSplat, Z up": (
        "OpenUSD ab 26.03, ParticleField3DGaussianSplat, Z zeigt nach oben"
    ),
    "Photos that were dropped; all photos of their folder are used": (
        "Fotos, die hereingezogen wurden; alle Fotos ihres Ordners werden verwendet"
    ),
    "Pixels from the left edge of the photo": "Pixel vom linken Rand des Fotos",
    "Pixels from the top edge of the photo": "Pixel vom oberen Rand des Fotos",
    "Project folder of this scene": "Projektordner dieser Szene",
    (
        "Python 3.11, 3.12 or 3.13 that the engine is set up with. Empty: Blender's own where PyTorch can be "
        "had for it, or another one of this computer"
    ): (
        "Python 3.11, 3.12 oder 3.13, mit dem die Engine eingerichtet wird. Leer: das von Blender, wenn es "
        "PyTorch dafür gibt, sonst ein anderes dieses Computers"
    ),
    (
        "Python with the engine's packages that is run instead of the engine that was set up here. Empty: the"
        " one named by the environment variable GAUSSIAN_HERITAGE_PYTHON, or .venv/engine in the folder of "
        "this extension if it is a checkout of the repository, or the engine that was set up. No other place "
        "is searched, and no .blend file can change it"
    ): (
        "Python mit den Paketen der Engine, das statt der hier eingerichteten Engine läuft. Leer: das der "
        "Umgebungsvariablen GAUSSIAN_HERITAGE_PYTHON, oder .venv/engine im Ordner dieser Erweiterung, wenn "
        "sie eine Arbeitskopie des Repositorys ist, oder die eingerichtete Engine. Anderswo wird nicht "
        "gesucht, und keine .blend-Datei kann das ändern"
    ),
    "Reconstruct this scene again, in the same project, from the same photos, with a better preset": (
        "Diese Szene im selben Projekt, aus denselben Fotos, mit einer besseren Voreinstellung neu rekonstruieren"
    ),
    "Remove a known distance, or all that was measured. The scene gets its former place and size": (
        "Einen bekannten Abstand oder alles Gemessene entfernen. Die Szene bekommt ihre frühere Lage und Größe"
    ),
    "Replace existing files": "Vorhandene Dateien ersetzen",
    "Select the isolated object that is seen at the click": "Das freigestellte Objekt am Klick auswählen",
    "Select this object in the list, and look at it": "Dieses Objekt in der Liste auswählen und ansehen",
    "Selected splats, including whole scenes": "Ausgewählte Splats, auch ganze Szenen",
    "In a new file, set the render engine to Cycles, with the settings that splats need": (
        "In einer neuen Datei Cycles als Renderer wählen, mit den Einstellungen, die Splats brauchen"
    ),
    (
        "Share of the Gaussians in view that are drawn, the most important first: opacity times mean "
        "diameter, divided by the distance"
    ): (
        "Anteil der Gauß-Glocken im Blick, die gezeichnet werden, die wichtigsten zuerst: Deckkraft mal "
        "mittlerer Durchmesser, geteilt durch die Entfernung"
    ),
    "Show the folder of the project in the system's file browser": "Den Ordner des Projekts zeigen",
    "Show the isolated objects": "Die freigestellten Objekte zeigen",
    "Show the licence of each model, and who may use it": "Die Lizenz jedes Modells zeigen, und wer es benutzen darf",
    "Show the whole scene": "Die ganze Szene zeigen",
    "Show what floats around the object, isolated or faint Gaussians, as a selection in Edit Mode; or remove it": (
        "Was um das Objekt schwebt, einzelne oder blasse Gauß-Glocken, im Bearbeitungsmodus auswählen; oder entfernen"
    ),
    "Skip Gaussians of a PLY with invalid values instead of rejecting the file": (
        "Gauß-Glocken einer PLY-Datei mit ungültigen Werten auslassen, statt die Datei abzulehnen"
    ),
    "Smaller; includes Apple's graphics processors on a Mac": (
        "Kleiner; auf einem Mac mit den Grafikprozessoren von Apple"
    ),
    "Smallest membership of a Gaussian in the object; higher values make the object tighter": (
        "Kleinste Zugehörigkeit einer Gauß-Glocke zum Objekt; höhere Werte machen es enger"
    ),
    "Standard file of 3D Gaussian splatting, -Y up as its viewers expect": (
        "Übliche Datei für 3D Gaussian Splatting; -Y zeigt nach oben, wie es deren Betrachter erwarten"
    ),
    "Start the stopped job again. It continues with the work that is finished": (
        "Die angehaltene Arbeit wieder starten. Fertiges bleibt"
    ),
    "Stop the running job. Start the same import again to resume it": (
        "Die laufende Arbeit anhalten. Derselbe Import setzt sie fort"
    ),
    "Store in the project what Blender shows otherwise. What this replaces or deletes goes to the project's trash": (
        "Im Projekt speichern, was Blender anders zeigt. Was dabei ersetzt oder gelöscht wird, kommt in den Papierkorb"
    ),
    "Take the Gaussians selected in Edit Mode away from their object. They stay in the scene": (
        "Die Auswahl im Bearbeitungsmodus von ihrem Objekt wegnehmen. In der Szene bleibt sie"
    ),
    "Take them from the object instead of showing them": "Sie vom Objekt wegnehmen, statt sie zu zeigen",
    "Take what the region shows of the object away from it": "Was der Bereich vom Objekt zeigt, wird weggenommen",
    "The known distance in metres": "Der bekannte Abstand in Metern",
    "The object in English words, for example vase": "Das Objekt in Worten, auf Englisch, zum Beispiel vase",
    "The origin of each object is that of its file": "Der Ursprung jedes Objekts ist der seiner Datei",
    "The point that becomes the origin": "Der Punkt, der zum Ursprung wird",
    "The preset after that of the scene": "Die Voreinstellung nach der der Szene",
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
    "What is searched for at the end, in English words, separated by commas (vase, teapot)": (
        "Was am Ende gesucht wird, in englischen Wörtern, durch Kommas getrennt (vase, teapot)"
    ),
    "What the file states; otherwise Y for SPZ, and -Y as in the files of most programs": (
        "Was die Datei angibt; sonst Y für SPZ, und -Y wie in den Dateien der meisten Programme"
    ),
    "What the photos say about their cameras": "Was die Fotos über ihre Kameras aussagen",
    "What the points mean": "Was die Punkte bedeuten",
    (
        "Write the catalogue record and how the object was made into the file. Without it, an imported PLY "
        "that was not edited is written as it was"
    ): (
        "Inventardaten und Entstehung des Objekts in die Datei schreiben. Ohne sie wird eine importierte PLY-"
        "Datei, die nicht bearbeitet wurde, unverändert geschrieben"
    ),
    "Y points down, as in most Gaussian scenes": "Y zeigt nach unten, wie in den meisten Gauß-Szenen",
    "Y points up": "Y zeigt nach oben",
    "Z points up, as in Blender": "Z zeigt nach oben, wie in Blender",
    "Set Cycles, transparent bounces, samples, pixel filter and view transform of this scene to what splats need": (
        "Stellt Cycles, transparente Sprünge, Abtastungen, Pixelfilter und Ansichtstransformation für Splats ein"
    ),
    "Set the render settings back to what they were before splats came; what you changed since then stays": (
        "Stellt die Rendereinstellungen von vorher wieder her; was Sie danach geändert haben, bleibt"
    ),
}
"""German text by English text, as Blender shows them."""
